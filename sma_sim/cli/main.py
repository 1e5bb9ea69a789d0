"""The command `sma-sim`."""

from __future__ import annotations

import argparse
import os
import sys
import traceback

from sma_sim.cli import (
    add,
    bag,
    challenge,
    compare,
    diagnose,
    effects,
    fit,
    init,
    latent,
    next,
    paper,
    play,
    plot,
    simulate,
    tour,
)
from sma_sim.model.errors import UserError

VERBS = (tour, init, simulate, fit, compare, diagnose, latent, add, next, play, plot, bag, effects, challenge, paper)
BROKEN_PIPE = 141  # as a shell says of a program that SIGPIPE ended


def main(arguments: list[str] | None = None) -> int:
    """Run one verb; exit code 0 when done, 2 for a user's mistake, 1 for our fault."""
    parser = argparse.ArgumentParser(
        prog='sma-sim', description='Simulate soft robots driven by shape-memory-alloy wires.'
    )
    verbs = parser.add_subparsers(dest='verb', required=True)
    for verb in VERBS:
        verb.add_parser(verbs)
    chosen = parser.parse_args(arguments)
    try:
        code = int(chosen.run(chosen))
        sys.stdout.flush()
        return code
    except UserError as error:
        print(f'sma-sim {chosen.verb}: {error}', file=sys.stderr)
        return 2
    except BrokenPipeError:  # whoever read our output has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return BROKEN_PIPE
    except KeyboardInterrupt:
        print(f'sma-sim {chosen.verb}: stopped', file=sys.stderr)
        return 130
    except Exception:
        traceback.print_exc()
        print(f'sma-sim {chosen.verb}: this is a fault of sma_sim, please report it', file=sys.stderr)
        return 1


if __name__ == '__main__':
    sys.exit(main())
