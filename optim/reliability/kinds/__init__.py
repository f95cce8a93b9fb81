"""Estimators of failure probabilities, a file each."""
