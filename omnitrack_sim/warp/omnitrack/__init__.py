"""The paper's robot in environments on a device."""
