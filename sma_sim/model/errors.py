"""What is raised for a mistake of the user's, and what warns of a result that no robot can have."""


class UserError(ValueError):
    """A mistake in what the user gave: the message says what was given, what is expected and where to change it."""


class PhysicsWarning(UserWarning):
    """A result beyond what its equations describe, such as a wire hotter than its alloy melts."""
