"""What an object is: `kinds` names it, `population` holds the solved ones that it compares with."""
