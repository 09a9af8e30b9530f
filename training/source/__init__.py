"""What models of change learn from: sequences, and what they tell of when and how texels change."""
