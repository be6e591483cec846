"""What holds for every test."""

import signal


def pytest_configure() -> None:
    """Take Ctrl-C as at a terminal: whoever starts the tests in the background may have it ignored, and children
    inherit that.
    """
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
