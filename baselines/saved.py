"""A saved policy: an ONNX file and its contract. Running it needs no torch, learner or pickle."""

import hashlib
import json
from pathlib import Path

import numpy as np
import onnxruntime

from backends.state import Array
from baselines._network import PolicyError, check_network
from files.bounded import FileError, one_line, read_json
from tasks.observation import Observation

POLICY_FILE, CONTRACT_FILE = "policy.onnx", "contract.json"


class SavedPolicy:
    """A deterministic policy read from a run folder.

    Raises PolicyError if a file is missing or damaged, or if the policy was trained on another
    observation than the given one.
    """

    def __init__(self, folder: Path, observation: Observation) -> None:
        contract = read_contract(folder)
        if contract != observation.contract():
            raise PolicyError(_difference(contract, observation.contract()))
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = 1
        options.inter_op_num_threads = 1
        path = folder / POLICY_FILE
        check_network(path, observation.width, len(observation.hand.driven))
        try:
            self._session = onnxruntime.InferenceSession(str(path), options)
        except Exception as error:  # noqa: BLE001 - onnxruntime raises bare classes of its own
            said = one_line(str(error))
            raise PolicyError(f"{path} cannot be read as a policy: {said}") from error
        self._path, self._width = path, len(observation.hand.driven)

    def __call__(self, observation: Array) -> Array:
        """Actions (N, J) in [-1, 1] from observations (N, width)."""
        try:
            action = np.asarray(self._session.run(["action"], {"observation": observation})[0])
        except Exception as error:  # noqa: BLE001 - onnxruntime raises bare classes of its own
            said = one_line(str(error))
            raise PolicyError(f"{self._path} gives no actions: {said}") from error
        wanted = (len(observation), self._width)
        if action.shape != wanted or not np.isfinite(action).all():
            raise PolicyError(
                f"{self._path} gives actions of shape {action.shape}; allowed: {wanted}, a row per "
                "observation, all of them finite"
            )
        return action


def write_contract(folder: Path, observation: Observation) -> None:
    """Write the contract of the policy in this folder."""
    text = json.dumps(observation.contract(), indent=2)
    temporary = folder / f".{CONTRACT_FILE}.tmp"
    temporary.write_text(text + "\n")
    temporary.replace(folder / CONTRACT_FILE)


def read_contract(folder: Path) -> dict:
    """The contract of a saved policy; raises PolicyError when it is missing or damaged."""
    path = folder / CONTRACT_FILE
    try:
        contract = read_json(path)
    except FileNotFoundError:
        raise PolicyError(f"no policy here: {path} does not exist") from None
    except FileError as error:
        raise PolicyError(str(error)) from error
    channels = contract.get("observation") if isinstance(contract, dict) else None
    if not isinstance(channels, list) or not all(isinstance(c, dict) for c in channels):
        raise PolicyError(f"{path} is no contract: it lists no observation, channel by channel")
    return contract


def file_sha256(path: Path) -> str:
    """SHA-256 of a file, hexadecimal."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _difference(policy: dict, wanted: dict) -> str:
    def layout(contract: dict) -> str:
        channels = contract.get("observation", [])
        return ", ".join(f"{c.get('name')} ({c.get('width')})" for c in channels)

    return (
        f"the policy does not fit this observation: it was trained on [{layout(policy)}], "
        f"this observation gives [{layout(wanted)}]; use the observation it was trained on"
    )
