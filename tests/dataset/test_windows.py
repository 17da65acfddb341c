"""Windows never span a jump in time; their order is a function of seed and epoch."""

from itertools import islice

from hypothesis import given, settings
from hypothesis import strategies as st

from lavsim.dataset.record import EpisodeRecord
from lavsim.dataset.windows import Sampler, SamplerState, Windows


def episode(number: int, frames: int, *breaks: int) -> EpisodeRecord:
    return EpisodeRecord(number, "t", "r", 0, frames, 5 * frames, 0.0, "end", 0, {}, {}, breaks)


def test_windows_are_all_frames_with_enough_behind_them() -> None:
    windows = Windows([episode(0, 5), episode(1, 0), episode(3, 3), episode(4, 2)], steps=2)
    assert [windows[k] for k in range(len(windows))] == [(0, 0), (0, 1), (0, 2), (3, 0)]


def test_no_window_spans_a_jump() -> None:
    windows = Windows([episode(0, 8, 3, 5)], steps=2)
    assert [windows[k] for k in range(len(windows))] == [(0, 0), (0, 5)]


def test_a_stride_thins_windows() -> None:
    windows = Windows([episode(0, 10)], steps=1, stride=4)
    assert [frame for _, frame in (windows[k] for k in range(len(windows)))] == [0, 4, 8]


def test_each_epoch_has_every_number_once_in_another_order() -> None:
    sampler = Sampler(50, seed=1)
    given_ = list(islice(sampler, 100))
    assert sorted(given_[:50]) == sorted(given_[50:]) == list(range(50))
    assert given_[:50] != given_[50:]
    assert list(islice(Sampler(50, seed=2), 50)) != given_[:50]


@settings(deadline=None)
@given(st.integers(1, 60), st.integers(0, 150), st.integers(0, 3))
def test_a_sampler_goes_on_where_it_was(count: int, taken: int, seed: int) -> None:
    whole = Sampler(count, seed)
    first = list(islice(whole, taken))
    state = SamplerState(whole.state.epoch, whole.state.position)
    assert list(islice(Sampler(count, seed, state), 20)) == list(islice(whole, 20))
    assert first + list(islice(Sampler(count, seed, state), 5)) == list(islice(Sampler(count, seed), taken + 5))


def test_shares_are_disjoint_and_equally_large() -> None:
    shares = [Sampler(11, 0, share=k, shares=3).order(4).tolist() for k in range(3)]
    assert [len(share) for share in shares] == [3, 3, 3] == [len(Sampler(11, 0, share=k, shares=3)) for k in range(3)]
    assert len({number for share in shares for number in share}) == 9
