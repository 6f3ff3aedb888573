"""CodeNeRF without a screen: the field, rendering, fitting and training."""
