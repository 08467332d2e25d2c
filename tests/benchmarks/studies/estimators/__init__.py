"""What the estimators of the interaction frequency are worth."""
