"""What each verb prints: a headline and rows, a file a group of verbs."""
