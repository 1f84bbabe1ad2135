"""Jinja templates of the engines' input decks."""
