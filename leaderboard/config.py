"""What a user sets for an evaluation."""

from __future__ import annotations

import difflib
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator, model_validator

from lavsim.agent import AgentSpec, Track
from lavsim.errors import ConfigError, UnknownName
from lavsim.random import Draws
from lavsim.traffic.profiles import TRAFFIC_PROFILES
from leaderboard.rules import Rules, get_rules


class EvaluationConfig(BaseModel):
    """One run of `lavsim score`; frozen, unknown keys are refused."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    agent: str = Field(description="module:Class, file.py or file.py:Class")
    routes: str = Field("quick", description="name of a packaged route file, or a path")
    out: Path = Field(Path("runs/score"), description="folder of the run")
    agent_config: str | None = Field(None, description="handed to the agent's setup as it is")
    route_ids: str | None = Field(None, description="ids and ranges of the file ('0,3-5'); None: all")
    scenarios_json: Path | None = Field(None, description="hazards in the 1.0 format")
    rules: str = Field("1.0", description="version of the leaderboard's rules")
    seed: int = Field(0, ge=0, description="root of all draws of the first repetition")
    repetitions: int = Field(1, ge=1, description="drives of each route, each with a seed of its own")
    traffic: str | None = Field(None, description="profile for route files that name none; None: leaderboard")
    track: str | None = Field(None, description="track the agent must be on; None: its own")
    sensors: str | None = Field(None, description="suite that is rendered beside what the agent asks for")
    latency: int = Field(0, ge=0, description="ticks by which an agent's controls act late")
    town_path: tuple[Path, ...] = Field((), description="folders with towns that are not bundled")
    overwrite: bool = Field(False, description="replace a run in the folder")
    resume: bool = Field(False, description="go on with the run in the folder")
    workers: int = Field(1, ge=1, description="processes that drive side by side")
    cluster: str | None = Field(None, description="address of a Ray cluster that drives instead; 'local' starts one")
    step_timeout: float = Field(60.0, gt=0.0, description="wall-clock limit of an agent's step [s]")
    setup_timeout: float = Field(600.0, gt=0.0, description="wall-clock limit of an agent's set-up [s]")
    memory_limit: int = Field(16 * 2**30, gt=0, description="resident memory of the agent's processes [bytes]")
    strict_compat: bool = Field(False, description="keep the bookkeeping defects of the original results file")
    pictures: bool = Field(True, description="draw a contact sheet of each drive")
    drawings: bool = Field(False, description="keep what the agent shows of its inner view beside each log")

    @field_validator("traffic")
    @classmethod
    def _known_traffic(cls, value: str | None) -> str | None:
        if value is not None and value not in TRAFFIC_PROFILES:
            raise UnknownName("traffic profile", value, TRAFFIC_PROFILES)
        return value

    @field_validator("rules")
    @classmethod
    def _known_rules(cls, value: str) -> str:
        return get_rules(value).version

    @field_validator("track")
    @classmethod
    def _known_track(cls, value: str | None) -> str | None:
        if value is not None and value not in {t.value for t in Track}:
            raise UnknownName("track", value, (t.value for t in Track))
        return value

    @model_validator(mode="before")
    @classmethod
    def _known_keys(cls, values: Any) -> Any:
        for key in values if isinstance(values, dict) else ():
            if key not in cls.model_fields:
                near = difflib.get_close_matches(str(key), cls.model_fields, n=1)
                hint = f" Did you mean {near[0]!r}?" if near else ""
                raise ConfigError(f"no setting {key!r} of an evaluation.{hint}")
        return values

    @staticmethod
    def of(**values: Any) -> EvaluationConfig:
        """The configuration of `values`.

        Raises:
            ConfigError, UnknownName: one line that says which value is wrong.
        """
        try:
            return EvaluationConfig(**values)
        except ValidationError as error:
            first = error.errors()[0]
            name = ".".join(map(str, first["loc"])) or "evaluation"
            raise ConfigError(f"{name}: {first['msg']}, got {first['input']!r}") from None

    @model_validator(mode="after")
    def _one_original(self) -> EvaluationConfig:
        if self.strict_compat and self.rules == "corrected":
            raise ConfigError("--strict-compat keeps mistakes that --rules corrected mends: give one of them")
        return self

    @model_validator(mode="after")
    def _one_way_to_begin(self) -> EvaluationConfig:
        if self.overwrite and self.resume:
            raise ConfigError("--overwrite starts anew and --resume goes on: give one of them")
        return self

    def decisive(self) -> dict[str, Any]:
        """What decides the results, in JSON types: all but how the work is done."""
        return self.model_dump(mode="json", exclude={"overwrite", "resume", "workers", "cluster", "drawings"})

    @property
    def rule_set(self) -> Rules:
        return get_rules(self.rules)

    def agent_spec(self) -> AgentSpec:
        """The agent and its limits."""
        return AgentSpec(
            target=self.agent,
            config_path=self.agent_config,
            generation=self.rule_set.generation,
            step_timeout=self.step_timeout,
            setup_timeout=self.setup_timeout,
            memory_limit=self.memory_limit,
            drawings=self.drawings,
        )

    def seed_of(self, repetition: int) -> int:
        """The seed of a repetition: the run's own for the first, for the others a hash of it and their number."""
        if repetition == 0:
            return self.seed
        return Draws.of_seed(self.seed).stream("repetition", repetition).key >> 1  # fits a signed 64-bit word


def traffic_of(file_profile: str | None, config: EvaluationConfig) -> str:
    """The traffic profile of a route: what its file names, else what the user set, else the rules' own."""
    return file_profile or config.traffic or "leaderboard"
