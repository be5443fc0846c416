"""Every annotation is executed, and the numerics run strict: float64, no silent broadcasting."""

import jax
from jaxtyping import install_import_hook

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_numpy_rank_promotion", "raise")
jax.config.update("jax_numpy_dtype_promotion", "strict")

install_import_hook("jaxrender", "beartype.beartype")
