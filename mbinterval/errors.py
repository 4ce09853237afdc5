"""What mbinterval raises, and nothing else, when a user can mend the cause.

Every message says what is wrong, where, and what to do. The command line maps each class to
its exit code; library code never exits, prints or asserts on input.
"""


class MbintervalError(Exception):
    """Base of all errors that mbinterval raises on purpose."""

    exit_code = 1


class UsageError(MbintervalError, ValueError):
    """A setting or an argument is out of its range or unknown."""

    exit_code = 2


class SceneError(MbintervalError, ValueError):
    """A scene, or a file that it names, is wrong: the message gives file, field and remedy."""

    exit_code = 3


class DeviceError(MbintervalError):
    """No usable OpenCL device, or the device failed."""

    exit_code = 4


class KernelBuildError(DeviceError):
    """A kernel did not compile; the message ends with the compiler's log."""


class CapacityError(MbintervalError):
    """The render needs more memory than the device or the given limit has."""

    exit_code = 5


class OutputError(MbintervalError):
    """An image cannot be written, or one that was written cannot be read back."""

    exit_code = 6


class Terminated(KeyboardInterrupt):
    """The process was asked to end, by SIGTERM; everything unwinds as after Ctrl-C."""


def exit_code(error: BaseException) -> int:
    """Exit code for what ended a command; for signals 128 and the signal, as shells have it."""
    if isinstance(error, Terminated):
        return 143
    if isinstance(error, KeyboardInterrupt):
        return 130
    if isinstance(error, MemoryError):
        return CapacityError.exit_code
    return error.exit_code if isinstance(error, MbintervalError) else MbintervalError.exit_code
