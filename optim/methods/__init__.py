"""How a problem is solved: evolutionary methods, nonlinear programming and the manual procedure."""
