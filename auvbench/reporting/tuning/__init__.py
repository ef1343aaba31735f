"""What a person reads of a study: its page, its figures, its sentences."""
