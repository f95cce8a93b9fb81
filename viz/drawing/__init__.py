"""What is drawn: surfaces, where they are over time, their projection and their pixels."""
