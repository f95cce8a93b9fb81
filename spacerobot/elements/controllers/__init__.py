"""Controllers of tips and robots: base classes, and one file for each kind that ships."""
