"""What a user does: plan, scan, store, detect, show."""
