"""Results as JSON can hold them."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from sma_sim.evidence.data.tables import write_whole


def finite(content: Any) -> Any:
    """The same with null in place of NaN and infinities, which JSON does not know; tuples become lists."""
    if isinstance(content, Mapping):
        return {str(key): finite(value) for key, value in content.items()}
    if isinstance(content, list | tuple):
        return [finite(value) for value in content]
    return None if isinstance(content, float) and not math.isfinite(content) else content


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    """Write JSON, whole or not at all; what is no finite number becomes null. Raises UserError."""
    write_whole(path, lambda file: file.write(json.dumps(finite(content), indent=2) + '\n'))
