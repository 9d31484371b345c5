"""Errors for misuse of environments: both of `cornerforge.errors` and Gymnasium's own.

Clients of Gymnasium catch the second kind, clients of cornerforge the first.
"""

from __future__ import annotations

import gymnasium

from cornerforge.errors import InputError

__all__ = ["ClosedError", "InvalidActionError", "ResetNeededError", "warn_of_no_picture"]


class ResetNeededError(InputError, gymnasium.error.ResetNeeded):
    """No test runs: it has not begun, or it has ended."""


class InvalidActionError(InputError, gymnasium.error.InvalidAction):
    """An action is not one of the action space."""


class ClosedError(InputError, gymnasium.error.ClosedEnvironmentError):
    """The environment was closed."""


def warn_of_no_picture() -> None:
    """Warn, as Gymnasium's own environments do, that `render` gives nothing without a render mode."""
    gymnasium.logger.warn(
        'There is no picture without a render mode; make the environment with render_mode="rgb_array".'
    )
