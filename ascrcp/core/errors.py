"""The one tree of errors: what was wrong, where, and what is allowed."""

import signal


class AscrcpError(Exception):
    """Base of every error this project raises on purpose; the message is one clear line."""


class InputError(AscrcpError):
    """Bad input from outside (file, option, configuration, array). The CLI exits 2 on it."""


class ConfigError(InputError):
    """A configuration file that breaks its schema: file, key, value, allowed range."""


class RecognitionError(InputError):
    """A cloud in which no tunnel heading can be found; the message says what is missing."""


class NothingToSprayError(InputError):
    """A wall on which nothing can be sprayed, or nothing lacks enough to be; the message says which."""


class UnreachableError(AscrcpError):
    """A pose or path the arm cannot reach; the message names the reason."""


class DeviceError(AscrcpError):
    """A device that cannot be opened, answers wrongly or went away."""


class RefusedError(AscrcpError):
    """A request the state machine does not allow now; the message says why."""


class CancelledError(AscrcpError):
    """A job the operator cancelled. Nothing half-written remains."""


class EndedError(AscrcpError):
    """A signal asked the program to end; what it was doing is stopped in order.

    Attributes:
        exit_code: 128 and the signal's number, as shells count it.
    """

    def __init__(self, number: signal.Signals) -> None:
        super().__init__(f"ended by {number.name}")
        self.exit_code = 128 + number


class DefectError(AscrcpError):
    """An error nobody expected: a defect of this program, reported with its traceback as a note."""
