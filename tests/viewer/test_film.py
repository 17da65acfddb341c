"""Films, film strips, sensor panes: written, read back, and shown in the browser."""

from __future__ import annotations

import struct
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from lavsim.errors import OutputError
from lavsim.random import Draws
from lavsim.render.gif import encode_gif
from lavsim.render.video import VideoWriter
from lavsim.viewer.film import Cut, Footage, write_film, write_strip
from lavsim.viewer.inner import InnerView
from lavsim.viewer.panes import joined_cameras, render_panes
from lavsim.viewer.replay import Story, replay_page
from lavsim.viewer.tracks import read_tracks
from tests.browser import Window
from tests.viewer import drives
from tests.viewer.test_drawings import some


def footage() -> Footage:
    inner = InnerView.of([(snapshot.tick, some()) for snapshot in drives.snapshots()])
    return Footage(drives.snapshots(), drives.town(), Draws.of_seed(0), drives.route().points, inner)


def pictures(count: int = 5) -> list[np.ndarray]:
    """Flat colours with a square that moves."""
    made = []
    for k in range(count):
        image = np.full((60, 80, 3), (40, 160, 220), np.uint8)
        image[20:40, 8 * k : 8 * k + 16] = (200, 30, 10)
        made.append(image)
    return made


@pytest.mark.parametrize(("suffix", "with_av"), [(".mp4", True), (".mp4", False), (".webm", False), (".gif", False)])
def test_film_is_read_back(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, suffix: str, with_av: bool) -> None:
    if with_av:
        pytest.importorskip("av", reason="PyAV is not installed")
    else:
        monkeypatch.setitem(sys.modules, "av", None)
    path = tmp_path / f"a{suffix}"
    with VideoWriter(path, 10.0) as film:
        for image in pictures():
            film.add(image)
    reader = cv2.VideoCapture(str(path))
    frames = []
    while (found := reader.read())[0]:
        frames.append(found[1])
    assert len(frames) == 5
    assert np.abs(frames[-1].astype(int) - pictures()[-1]).mean() < 6.0
    assert [file.name for file in tmp_path.iterdir()] == [path.name]


def test_gif_is_exact_for_few_colours(tmp_path: Path) -> None:
    content = encode_gif(pictures(), 10.0)
    assert content[:6] == b"GIF89a"
    assert struct.unpack("<HH", content[6:10]) == (80, 60)
    (tmp_path / "a.gif").write_bytes(content)
    done, animation = cv2.imreadanimation(str(tmp_path / "a.gif"))
    assert done
    for frame, image in zip(animation.frames, pictures(), strict=True):
        assert np.abs(frame[..., :3].astype(int) - image).max() <= 8
    noise = np.random.default_rng(0).integers(0, 255, (90, 120, 3)).astype(np.uint8)
    (tmp_path / "b.gif").write_bytes(encode_gif([noise, noise], 10.0))
    done, animation = cv2.imreadanimation(str(tmp_path / "b.gif"))
    assert done
    assert np.array_equal(animation.frames[0], animation.frames[1])


def test_film_that_has_no_picture_or_another_name_is_refused(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match=r"\.mp4, \.webm, \.gif"):
        VideoWriter(tmp_path / "a.avi", 10.0)
    with pytest.raises(OutputError, match="no picture"):
        VideoWriter(tmp_path / "a.mp4", 10.0).close()
    with pytest.raises(OutputError, match="no tick"):
        write_strip(Footage((), drives.town(), Draws.of_seed(0), drives.route().points), tmp_path / "a.png", 0.0)


def test_drive_is_filmed_with_its_speed_and_length(tmp_path: Path) -> None:
    write_film(footage(), tmp_path / "a.gif", Cut(1.0, 5.0, rate=5.0, speed=2.0, size=(160, 120)))
    done, animation = cv2.imreadanimation(str(tmp_path / "a.gif"))
    assert done
    assert len(animation.frames) == 11  # 4 s at twice the speed, 5 a second, both ends
    assert animation.frames[0].shape[:2] == (120, 160)


def test_film_with_panes_has_cameras_and_lidar_below(tmp_path: Path) -> None:
    write_film(footage(), tmp_path / "a.gif", Cut(1.0, 1.1, size=(320, 240), panes=True))
    done, animation = cv2.imreadanimation(str(tmp_path / "a.gif"))
    assert done
    assert animation.frames[0].shape[1] == 320 + 240
    assert animation.frames[0].shape[0] == 240 + 130  # four cameras in a row
    assert animation.frames[0][245:, :, :3].mean() > 40.0


def test_strip_shows_moments_in_a_row(tmp_path: Path) -> None:
    write_strip(footage(), tmp_path / "a.png", 5.0)
    image = cv2.imread(str(tmp_path / "a.png"))
    assert image is not None
    assert image.shape == (332, 6 * 326 + 6, 3)


def test_cameras_are_joined_to_one_width() -> None:
    cameras = [np.zeros((288, 256, 4), np.uint8)] * 3 + [np.zeros((288, 480, 4), np.uint8)]
    assert joined_cameras(cameras, 560).shape == (210 + 336, 560, 3)
    assert joined_cameras(cameras[:2], 560).shape[1] == 560


def test_replay_shows_what_the_sensors_saw(window: Window, tmp_path: Path) -> None:
    snapshots = drives.snapshots()[:40]
    panes = render_panes(drives.town(), snapshots, Draws.of_seed(0))
    assert (len(panes.film), len(panes.sweeps), panes.at[1]) == (8, 8, 5)
    assert all(100 < len(sweep) <= 1500 for sweep in panes.sweeps)
    tracks = read_tracks(snapshots)
    page = replay_page(tracks, {}, drives.town(), drives.route(), Story("a"), panes=panes)
    (tmp_path / "a.html").write_text(page)
    window.open(tmp_path / "a.html", "#t=1")
    window.until("document.querySelector('#pane-film canvas').width === 560")
    picture = window.ask("(c => [c.width, c.height, c.getContext('2d').getImageData(280, 20, 1, 1).data[2]])"
                         "(document.querySelector('#pane-film canvas'))")  # fmt: skip
    assert picture[:2] == [560, 546]
    assert picture[2] > 60
    assert window.page.locator("#pane-lidar").bounding_box()["width"] > 200.0


def test_films_play_in_the_browser(window: Window, tmp_path: Path) -> None:
    for suffix in (".mp4", ".webm"):
        with VideoWriter(tmp_path / f"a{suffix}", 10.0) as film:
            for image in pictures(12):
                film.add(image)
        (tmp_path / "a.html").write_text(f'<video id="v" src="a{suffix}" muted></video>')
        window.page.goto((tmp_path / "a.html").as_uri())
        window.page.wait_for_function(
            "document.getElementById('v').readyState >= 2 || document.getElementById('v').error"
        )
        assert window.ask("document.getElementById('v').videoWidth") == 80, suffix
