"""The command line: cases before anything is run, runs and their judgement, studies of accuracy, failure and cost.

Exit codes: 0 within tolerance, 1 out of tolerance, 2 a run failed, 3 bad input, 4 nothing was checked, 5 internal error.
"""

import io
import sys
import tempfile
import traceback
from contextlib import suppress

import typer

from cases import UserError
from verify.cli import before, computing, judging, studying
from verify.cli.shared import (
    BAD_INPUT,
    DEBUG,
    INTERNAL_ERROR,
    RUN_FAILED,
    app,
)
from verify.extras import missing_extra
from verify.runs.atomic import NO_ROOM

#: in the order of the help
COMMANDS = (before, computing, judging, studying)
#: what typer makes of Ctrl-C
INTERRUPTED = 130
STOPPED = "Stopped: what is finished is kept; the same command does the rest, `verify run --resume` behind checkpoints."


def main(arguments: list[str] | None = None) -> None:
    """Entry point of the command ``verify``; a user's mistake gets one sentence on stderr, no traceback."""
    for stream in (sys.stdout, sys.stderr):  # a letter that a terminal or pipe has no place for is none of the program's
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")
    sys.exit(_exit_code(arguments))


def _exit_code(arguments: list[str] | None) -> int:
    try:
        code = app(args=arguments, standalone_mode=False) or 0
        return _say(STOPPED, code) if code == INTERRUPTED else code
    except UserError as error:
        return _say(str(error), error.exit_code)
    except typer.Abort:
        return _say("Stopped.", RUN_FAILED)
    except typer.TyperException as error:
        return _say(error.format_message(), BAD_INPUT)
    except ModuleNotFoundError as error:
        missing = missing_extra(error)
        return _say(str(missing), BAD_INPUT) if missing else _internal(error, arguments)
    except BrokenPipeError:  # whoever reads the output has had enough
        sys.stderr.close()
        return 0
    except OSError as error:
        if error.errno in NO_ROOM:  # in the middle of a file it names none
            where = error.filename or "The disk"
            return _say(f"{where}: {_reason(error)}; make room, or name another folder.", RUN_FAILED)
        return _internal(error, arguments) if error.filename is None else _say(_refused(error), BAD_INPUT)
    except Exception as error:
        return _internal(error, arguments)


def _refused(error: OSError) -> str:
    """A file or folder that the system does not let us read or write."""
    return f"{error.filename}: {_reason(error)}; make it readable and writable, or name another."


def _reason(error: OSError) -> str:
    return (error.strerror or str(error)).lower()


def _internal(error: Exception, arguments: list[str] | None) -> int:
    """A mistake of the program, which is no verdict: one sentence, and the traceback for whoever mends it."""
    what = " ".join(f"{type(error).__name__}: {error}".split())
    if DEBUG not in (sys.argv[1:] if arguments is None else arguments):
        with suppress(OSError):  # a disk that takes nothing has it shown here
            with tempfile.NamedTemporaryFile("w", prefix="verify-", suffix=".txt", delete=False, encoding="utf8") as file:
                traceback.print_exception(error, file=file)
            remedy = f"please report it where you have the program from, with {file.name}"
            return _say(f"Internal error: {what}; {remedy} (`verify {DEBUG} ...` shows it here).", INTERNAL_ERROR)
    traceback.print_exception(error)
    return _say(f"Internal error: {what}; please report it with the traceback above.", INTERNAL_ERROR)


def _say(sentence: str, code: int) -> int:
    print(sentence, file=sys.stderr)
    return code
