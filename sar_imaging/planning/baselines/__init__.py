"""Plans of the published methods that AFBP and exact backprojection are compared with."""
