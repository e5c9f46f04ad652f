"""Processes in which work is done side by side."""

import multiprocessing


def fresh_processes(*preloaded: str) -> multiprocessing.context.BaseContext:
    """Where the platform can, copies of one process that has imported the modules of these names and computed nothing."""
    if "forkserver" not in multiprocessing.get_all_start_methods():
        return multiprocessing.get_context("spawn")
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(list(preloaded))
    return context
