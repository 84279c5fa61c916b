"""Contacts that turn and slip by the law of friction."""
