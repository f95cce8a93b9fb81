"""What a plan, a front or a study leaves in files, and the scenario that follows it."""
