"""Tables of recorders: text (CSV), Parquet, MATLAB, HDF5 and TDMS as traces.

A trace has one row a sample, ``time`` [ns UTC] or ``t`` [s] first, channels in the units of the
table of signals, and the rows that were rejected with line and reason.  Sources: RFC 4180; MAT-file
format of The MathWorks; HDF5; TDMS of NI.
"""

__all__ = ["arrays", "columnar", "csv_table"]
