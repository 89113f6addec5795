"""Pieces of work on several processes or machines, by ``dask.distributed``."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from typing import TYPE_CHECKING, TypeVar

from iwanjax.errors import InputError

if TYPE_CHECKING:
    from distributed import Client

Item = TypeVar("Item")
Found = TypeVar("Found")

LOCAL = "local"
"""A scheduler of this machine's own processes."""
# Workers that a piece may bring down before it is given up.
_DEATHS = 3


def pieces(
    function: Callable[[Item], Found],
    items: Sequence[Item],
    scheduler: str = LOCAL,
    workers: int | None = None,
) -> Iterator[tuple[int, Found]]:
    """What a function makes of each item, in the order in which that is done.

    A piece whose worker is killed goes to another one; the numbers are the same whichever does it.

    Parameters
    ----------
    function : function
        Of one item; both, and what it returns, can be pickled.
    items : sequence
    scheduler : str
        ``local``, or the address of one that runs, such as ``tcp://10.0.0.5:8786``; its workers
        need this package.
    workers : int, optional
        Local processes; by default one for each processor that this one may use.

    Yields
    ------
    index, result
        Of the item.

    Raises
    ------
    InputError
        Where ``dask.distributed`` is not installed, or no scheduler answers.
    """
    try:
        from distributed import as_completed
    except ImportError:
        raise InputError(
            "dask.distributed is not installed; install it with: pip install 'iwanjax[dist]'"
        ) from None
    with ExitStack() as stack:
        client = _client(stack, scheduler, workers)
        futures = client.map(function, items, pure=False, retries=_DEATHS)
        numbers = {future.key: i for i, future in enumerate(futures)}
        for future, found in as_completed(futures, with_results=True):
            yield numbers[future.key], found
            future.release()


def _client(stack: ExitStack, scheduler: str, workers: int | None) -> "Client":
    from distributed import Client, LocalCluster

    if scheduler != LOCAL:
        try:
            return stack.enter_context(Client(scheduler))
        except (OSError, ValueError) as error:
            raise InputError(
                f"--scheduler {scheduler}: {error}; expected local, or the address of a scheduler "
                "that runs, such as tcp://10.0.0.5:8786"
            ) from None
    from iwanjax.threads import available_threads

    cluster = LocalCluster(
        n_workers=workers or available_threads(),
        threads_per_worker=1,
        dashboard_address=":0",  # any free port: two runs may go side by side
    )
    return stack.enter_context(Client(stack.enter_context(cluster)))
