"""What a search for laws is measured on: physics that no effect describes, and how an answer is judged."""
