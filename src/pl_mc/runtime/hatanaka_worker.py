"""The one file that speaks to the Hatanaka decompressor: compressed text on standard input, RINEX text out.

It is run as a program of its own, ``python hatanaka_worker.py LARGEST_BYTES``, and imports nothing of this package:
the decompressor is a native program, and one that hangs or breaks down must end a child process and not the
analysis. `pl_mc.runtime.unpacking` starts it with a time limit.
"""

from __future__ import annotations

import sys
import warnings

EXIT_REFUSED = 3


def main(arguments: list[str]) -> int:
    """Decompress standard input to standard output; returns the exit code, with a reason on standard error."""
    import hatanaka

    content = sys.stdin.buffer.read()
    try:
        # The decompressor warns where it loses data; a shorter series is not what the user gave.
        with warnings.catch_warnings():
            warnings.simplefilter("error", UserWarning)
            text = hatanaka.crx2rnx(content)
    except (hatanaka.HatanakaException, UserWarning, OSError) as error:
        reason = " ".join(str(error).split()).removeprefix("crx2rnx: ").split(". ")[0].rstrip(".")
        sys.stderr.write(reason)
        return EXIT_REFUSED
    if len(text) > int(arguments[0]):
        sys.stderr.write(f"it unpacks to more than {int(arguments[0]) / 1e9:g} GB")
        return EXIT_REFUSED
    sys.stdout.buffer.write(text)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
