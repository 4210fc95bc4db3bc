"""The paper's experiments: every law on every experiment, tables and figures."""
