"""Goals of plans: base class, instant of a plan, and one file for each kind that ships."""
