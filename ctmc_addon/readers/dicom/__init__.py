"""DICOM: headers, series, geometry and pixels."""
