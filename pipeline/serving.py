"""The model that MLflow serves: a spindle's temperature from its state table (models from code)."""

from pathlib import Path
from typing import Any

import mlflow
import pandas as pd

from pipeline.twin.spindle import TARGET
from pipeline.twin.spindle_model import load_spindle_model


class Spindle(mlflow.pyfunc.PythonModel):
    """Predicts the spindle's temperature from a clean state table.

    The input has a ``time`` column and the columns that the model needs; of
    ``spindle_temperature`` only the first row is read, the measured temperature to start from.
    """

    def load_context(self, context: Any) -> None:
        """Load network and forest from the bundle."""
        bundle = Path(context.artifacts["bundle"])
        self.model = load_spindle_model(bundle / "spindle_thermal.json", bundle / "residual")

    def predict(
        self, context: Any, model_input: pd.DataFrame, params: dict[str, Any] | None = None
    ) -> pd.DataFrame:
        """Columns ``time``, ``spindle_temperature`` and ``physics`` [CELSIUS], one row a step."""
        for name in ("time", TARGET):
            if name not in model_input.columns:
                raise ValueError(f"the input has no column {name}: give the clean state table")
        start = float(model_input[TARGET].iloc[0]) if len(model_input) else float("nan")
        if pd.isna(start):
            raise ValueError(f"{TARGET} is not known in the first row: start where it was measured")
        state = model_input.set_index("time")
        return self.model.predict(state, start).reset_index(names="time")


mlflow.models.set_model(Spindle())
