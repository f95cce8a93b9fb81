"""Model predictive control: replanning during the simulation."""
