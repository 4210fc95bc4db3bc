"""The paper's vehicle with the recorded PX4's attitude loop: the values of what no configuration says."""

MASS_KG = 4.85
"""Total mass m_t with both arms."""
GRAVITY_MPS2 = 9.8
"""The paper's g."""
ATTITUDE_BANDWIDTH_RADPS = 7.7
"""Natural frequency of the closed attitude loop about roll and pitch (docs/px4-conformance.md)."""
