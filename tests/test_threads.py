import scipy.linalg  # noqa: F401
from threadpoolctl import threadpool_info

from iwanjax.threads import one_thread


def threads() -> list[int]:
    return [each["num_threads"] for each in threadpool_info() if each["user_api"] == "blas"]


def test_blas_keeps_to_one_thread_and_gets_its_own_back():
    before = threads()
    assert before
    with one_thread():
        assert set(threads()) == {1}
    assert threads() == before


def test_it_is_a_decorator_too():
    assert set(one_thread()(threads)()) == {1}
