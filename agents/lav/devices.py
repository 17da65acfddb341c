"""Where a training runs: one process or several, on CPUs or GPUs, and in which precision."""

from __future__ import annotations

import logging
import warnings
from dataclasses import fields, is_dataclass, replace
from typing import Any

import torch
from lightning_fabric import Fabric

from lavsim.errors import ConfigError


def make_fabric(precision: str = "float32", device: str = "cpu", processes: int = 1) -> Fabric:
    """Fabric of a training; `launch` begins its processes.

    Args:
        precision: "float32", "bfloat16" for convolutions, or "auto": bfloat16 where the hardware multiplies it.
        device: "cpu", "cuda", or "auto": a GPU if there is one.
        processes: On CPUs; on GPUs as many GPUs.

    Raises:
        ConfigError: there is no such device, or bfloat16 is asked of hardware that has to imitate it.
    """
    if device == "auto":
        device = "cuda" if torch.cuda.is_available() else "cpu"
    found = torch.cuda.device_count() if device == "cuda" else processes
    if found < processes:
        raise ConfigError(f"{processes} GPUs are asked for; torch finds {found}.")
    fast = has_bfloat16(device)
    if precision == "bfloat16" and not fast:
        raise ConfigError("this hardware has no bfloat16 arithmetic; train.precision = 'auto' leaves it out.")
    kind = "bf16-mixed" if fast and precision != "float32" else "32-true"
    # Fabric recommends workers and warns of its own internals; neither is the user's concern.
    warnings.filterwarnings("ignore", module="lightning_fabric")
    logging.getLogger("lightning_fabric").setLevel(logging.WARNING)
    strategy = "ddp_spawn" if processes > 1 else "auto"
    return Fabric(accelerator=device, devices=processes, strategy=strategy, precision=kind)  # type: ignore[arg-type]


def has_bfloat16(device: str) -> bool:
    """Whether convolutions in bfloat16 are faster: on CPUs without it they are ten times slower."""
    if device == "cuda":
        return torch.cuda.is_bf16_supported()
    found = torch.cpu.get_capabilities()
    return bool(found.get("avx512_bf16") or found.get("amx_bf16"))


def moved(batch: Any, device: torch.device) -> Any:
    """A batch with the tensors in its tuples, lists, dicts and dataclasses on a device."""
    if device.type == "cpu":
        return batch
    if isinstance(batch, torch.Tensor):
        return batch.to(device, non_blocking=True)
    if is_dataclass(batch) and not isinstance(batch, type):
        return replace(batch, **{item.name: moved(getattr(batch, item.name), device) for item in fields(batch)})
    if isinstance(batch, dict):
        return {name: moved(value, device) for name, value in batch.items()}
    if isinstance(batch, tuple | list):
        values = [moved(value, device) for value in batch]
        return type(batch)(*values) if hasattr(batch, "_fields") else type(batch)(values)
    return batch
