"""TGOSPA as a function of PyTorch, with its derivative: ``tgospa_eval.torch.tgospa``."""

from typing import Any

import numpy as np
import torch

from tgospa_eval.api.evaluate import evaluate


class _Tgospa(torch.autograd.Function):  # type: ignore[misc]  # its types are not installed
    """Forward by `evaluate`, backward by `Result.gradient`."""

    @staticmethod
    def forward(
        ctx: Any, estimate: torch.Tensor, truth: torch.Tensor, total: bool, options: dict[str, Any]
    ) -> torch.Tensor:
        sides = (side.detach().cpu().numpy().astype(np.float64) for side in (truth, estimate))
        whole, moved = sides
        result = evaluate(whole, moved, **options)
        if ctx.needs_input_grad[0]:
            gradient = result.gradient()
            ctx.slopes = gradient.array * (1.0 if total else gradient.root)
        return estimate.new_tensor(result.total if total else result.tgospa)

    @staticmethod
    def backward(ctx: Any, *change: torch.Tensor) -> tuple[torch.Tensor | None, ...]:
        slopes = change[0].new_tensor(ctx.slopes)
        return change[0] * slopes, None, None, None


def tgospa(
    truth: torch.Tensor, estimate: torch.Tensor, *, total: bool = False, **options: Any
) -> torch.Tensor:
    """TGOSPA of two tensors of states, differentiable by the estimate.

    Parameters
    ----------
    truth, estimate : (T, m, d), (T, n, d) Tensor
        States, NaN where an object is absent. Evaluated in double precision on the CPU.
    total : bool
        Whether to give the cost, TGOSPA to the power p, which is smooth where TGOSPA is 0.
    **options
        As for `tgospa_eval.evaluate`: ``cutoff``, ``order``, ``switch_penalty``, ``distance`` ...

    Returns
    -------
    Tensor
        A scalar. Its derivative is that of the best assignment, `Result.gradient`; absent states
        have the derivative 0.

    Raises
    ------
    ConfigError, InputError
        As for `evaluate` and `Result.gradient`.
    """
    found: torch.Tensor = _Tgospa.apply(estimate, truth, total, options)
    return found
