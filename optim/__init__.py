"""Optimisation over a closed loop: variables, objectives, GA, NLP, comparison."""
