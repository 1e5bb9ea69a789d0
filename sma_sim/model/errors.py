"""What is raised for a mistake of the user's."""


class UserError(ValueError):
    """A mistake in what the user gave: the message says what was given, what is expected and where to change it."""
