"""What is left unexplained, and where."""
