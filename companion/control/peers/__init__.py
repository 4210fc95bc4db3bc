"""Laws of other authors to compare with: the same interface, prediction and trigger; no part of ours."""
