"""What a command says of a user's mistake."""


class UserError(Exception):
    """A mistake in what the user gave: the message says what was given and what is expected."""
