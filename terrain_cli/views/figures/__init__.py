"""Pictures for paper: each function returns one matplotlib figure."""
