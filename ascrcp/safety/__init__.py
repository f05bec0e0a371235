"""The gate every command passes last: small, pure, no numpy, no input or output."""
