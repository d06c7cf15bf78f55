"""What turns raw numbers into true ones."""
