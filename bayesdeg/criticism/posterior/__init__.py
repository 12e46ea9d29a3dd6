"""What a posterior may be trusted with."""
