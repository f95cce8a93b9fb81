"""From an instant to a program: collocation, phases in a chain, first guesses, finer meshes."""
