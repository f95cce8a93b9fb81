"""What is rolled out: draws and sets of gains in, rows of numbers and series out."""
