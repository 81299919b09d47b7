"""Recordings as tables: text, Parquet, MATLAB, HDF5, TDMS."""
