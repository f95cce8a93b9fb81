"""What is measured, each beside what it is measured against, in the same run."""
