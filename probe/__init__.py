"""What a user does: plan, scan, store, detect, show. The public names are in `palpate`."""
