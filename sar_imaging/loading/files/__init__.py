"""Files of measured data: variables of NumPy, MATLAB, HDF5 and CSV files and of P440 logs."""
