"""References: base class, motions between knots, plan files, and one file for each kind that ships."""
