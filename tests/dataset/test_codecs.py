"""What comes out of a codec is what went in, to the codec's precision."""

import numpy as np
import pytest
import zstandard
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from lavsim.dataset.codecs import CODECS, decode, find_codec
from lavsim.errors import DatasetError

coordinates = st.floats(-327.625, 327.625, width=32)


@settings(max_examples=60, deadline=None)
@given(arrays(np.float32, st.tuples(st.integers(0, 40), st.just(3)), elements=coordinates))
def test_lidar_points_come_back_to_half_a_centimetre(xyz: NDArray[np.float32]) -> None:
    intensity = np.linspace(0.0, 1.0, len(xyz), dtype=np.float32)
    points = np.column_stack([xyz, intensity]).astype(np.float32)
    data = find_codec("lidar_cm").encode(points)
    back = decode("lidar_cm", data, ("points", 4))
    assert back.dtype == np.float32
    assert back.shape == points.shape
    assert np.all(np.abs(back[:, :3] - points[:, :3]) <= 0.00502)  # half a centimetre and float32's rounding
    assert np.all(np.abs(back[:, 3] - points[:, 3]) <= 0.00197)
    again = decode("lidar_cm", find_codec("lidar_cm").encode(back), ("points", 4))
    assert np.array_equal(again, back)


@pytest.mark.parametrize("value", [327.7, -400.0, np.nan, np.inf])
def test_points_too_far_for_the_codec_are_refused(value: float) -> None:
    points = np.zeros((3, 4), np.float32)
    points[1, 2] = value
    with pytest.raises(DatasetError, match="do not fit"):
        find_codec("lidar_cm").encode(points)


def test_layers_and_tags_come_back_exactly() -> None:
    rng = np.random.default_rng(0)
    layers = np.where(rng.random((5, 13, 7)) < 0.3, 255, 0).astype(np.uint8)
    assert np.array_equal(decode("packbits_zstd", CODECS["packbits_zstd"].encode(layers), (5, 13, 7)), layers)
    tags = rng.integers(0, 23, (9, 11), np.uint8)
    back = decode("zstd", CODECS["zstd"].encode(tags), (9, 11))
    assert np.array_equal(back, tags)
    back[0, 0] = 1  # what is read may be changed
    anything = rng.random((3, 2))
    assert np.array_equal(decode("npy_zstd", CODECS["npy_zstd"].encode(anything), ("values", 2)), anything)


def test_a_red_light_of_two_pixels_stays_red() -> None:
    image = np.full((96, 128, 3), (150, 160, 170), np.uint8)
    image[40:44, 60:64] = 20
    image[41:43, 61:63] = (250, 40, 40)
    back = decode("jpeg90", CODECS["jpeg90"].encode(image), (96, 128, 3)).astype(int)
    lamp = back[41:43, 61:63]
    assert back.shape == image.shape
    assert np.all(lamp[..., 0] - lamp[..., 1:].max(axis=-1) > 150)  # of 210; with 4:2:0 about 65 are left
    assert np.abs(back[:30] - image[:30]).max() <= 3


@pytest.mark.parametrize("name", sorted(CODECS))
def test_what_is_no_such_data_is_refused(name: str) -> None:
    for data in (b"", b"nonsense", zstandard.compress(b"12345")):
        with pytest.raises(DatasetError, match=name):
            decode(name, data, (2, 3, 1))


def test_an_unknown_codec_is_named() -> None:
    with pytest.raises(DatasetError, match=r"no codec 'jpeg91'\. Did you mean 'jpeg90'"):
        find_codec("jpeg91")
