"""Decks: the finished texts that an engine runs, and what they promise."""

from liftdrag.deck.model import Deck, Plan

__all__ = ["Deck", "Plan"]
