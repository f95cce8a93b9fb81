"""Estimators: base class, Kalman update, and one file for each kind that ships."""
