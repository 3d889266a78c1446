"""Image formation: time-domain correlation and backprojection."""
