"""Splits a dataset into parts, by whole episodes: by town, by share of the frames, or by number."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from lavsim.dataset.merge import Taken, Watch, identity, new_folder, put
from lavsim.dataset.reader import Dataset
from lavsim.dataset.record import EpisodeRecord
from lavsim.errors import DatasetError, UnknownName
from lavsim.random import Draws

Parts = dict[str, list[EpisodeRecord]]
EACH = "each"


def split(source: Path, out: Path, parts: Parts, copy: bool = False, watch: Watch | None = None) -> list[Dataset]:
    """Makes a dataset of each part in the folder `out`, named after the part.

    Args:
        source: The dataset.
        out: Folder to make.
        parts: Episodes of each part, as the functions below choose them; an episode may be in one part only.
        copy: Copies files that could be linked.
        watch: Is told the share that is done.

    Raises:
        DatasetError: an episode is in two parts, a part is empty, or a file is missing.
        OutputError: `out` exists or can't be written.
    """
    dataset, owner = Dataset(source), dict[int, str]()
    for name, records in parts.items():
        if not records:
            raise DatasetError(f"part {name!r} would have no episode.")
        for record in records:
            if record.episode in owner:
                raise DatasetError(f"episode {record.episode} is in {owner[record.episode]!r} and in {name!r}.")
            owner[record.episode] = name
    with new_folder(out) as root:
        for done, (name, records) in enumerate(parts.items()):
            facts = [Taken(dataset, record, {"split_from": record.episode}) for record in records]
            info = replace(dataset.info, config={"split": name, "of": dict(dataset.info.config)})
            put(root / name, info, facts, copy)
            if watch is not None:
                watch((done + 1) / len(parts))
    return [Dataset(out / name) for name in parts]


def by_town(dataset: Dataset, choice: str) -> Parts:
    """Parts by town.

    Args:
        dataset: What is split.
        choice: "each" for a part a town, or "train=eu_small_a+us_large_a,test=eu_small_b".

    Raises:
        UnknownName: no episode drives in such a town.
        DatasetError: the choice can't be read.
    """
    towns = list(dict.fromkeys(record.town for record in whole(dataset)))
    wanted = {town: [town] for town in towns} if choice == EACH else _named(choice, "+")
    for names in wanted.values():
        for name in names:
            if name not in towns:
                raise UnknownName("town in this dataset", name, towns)
    return {part: [r for r in whole(dataset) if r.town in names] for part, names in wanted.items()}


def by_share(dataset: Dataset, choice: str, seed: int) -> Parts:
    """Parts by share of the frames, as near as whole episodes allow; who goes where depends on seed and drive alone.

    Args:
        dataset: What is split.
        choice: "train=0.8,val=0.2".
        seed: Of the order in which episodes are dealt.

    Raises:
        DatasetError: the choice can't be read, or its shares are more than 1.
    """
    shares: dict[str, float] = {}
    for part, (text, *more) in _named(choice, "+").items():
        try:
            shares[part] = float(text)
        except ValueError:
            more = [text]
        if more or not 0.0 < shares.get(part, 0.0) <= 1.0:
            raise DatasetError(f"the share of {part!r} must be a number from 0 to 1, got {text!r}.")
    total = sum(shares.values())
    if total > 1.0 + 1e-9:
        raise DatasetError(f"shares add up to {total:g}, which is more than 1.")
    draws = Draws.of_seed(seed).stream("split")
    dealt = sorted(whole(dataset), key=lambda record: draws.stream(identity(record)).key)
    return _dealt(dealt, shares)


def by_number(dataset: Dataset, choice: str) -> Parts:
    """Parts by numbers of episodes.

    Args:
        dataset: What is split.
        choice: "train=0-79,val=80-99+120".

    Raises:
        DatasetError: the choice can't be read, or names an episode that the dataset lacks.
    """
    parts: Parts = {}
    for part, texts in _named(choice, "+").items():
        numbers = [number for text in texts for number in _numbers(text)]
        missing = [number for number in numbers if number not in dataset.episodes]
        if missing:
            raise DatasetError(f"{dataset.root.name} has no episode {missing[0]}.")
        parts[part] = [dataset.episodes[number] for number in numbers]
    return parts


def whole(dataset: Dataset) -> list[EpisodeRecord]:
    """Episodes that hold anything."""
    return [record for record in dataset.episodes.values() if record.frames or record.ticks]


def _dealt(records: Sequence[EpisodeRecord], shares: Mapping[str, float]) -> Parts:
    """Cuts the row of episodes where the shares of all frames end."""
    frames = sum(record.frames for record in records)
    parts: Parts = {}
    begin, counted, wanted = 0, 0, 0.0
    for part, share in shares.items():
        wanted += share * frames
        end = begin
        # The next episode still belongs here if more than half of it lies before the cut.
        while end < len(records) and counted + records[end].frames / 2.0 <= wanted:
            counted += records[end].frames
            end += 1
        parts[part], begin = list(records[begin:end]), end
    return {part: sorted(chosen, key=lambda record: record.episode) for part, chosen in parts.items()}


def _named(choice: str, mark: str) -> dict[str, list[str]]:
    """ "a=x+y,b=z" as {"a": ["x", "y"], "b": ["z"]}."""
    found: dict[str, list[str]] = {}
    for text in choice.split(","):
        part, equals, values = (piece.strip() for piece in text.partition("="))
        if (
            not equals
            or not part
            or not values
            or part in found
            or not part.replace("_", "").replace("-", "").isalnum()
        ):
            raise DatasetError(f"expected parts as 'train=…,val=…', got {choice!r}.")
        found[part] = values.split(mark)
    return found


def _numbers(text: str) -> range:
    first, dash, last = text.partition("-")
    try:
        return range(int(first), int(last if dash else first) + 1)
    except ValueError:
        raise DatasetError(f"expected numbers of episodes as '0-9' or '3', got {text!r}.") from None
