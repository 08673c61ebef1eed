"""Reader of DICOM: folders, single files, DICOMDIR and multi-frame objects.

The road: ``discovery`` lists files, ``elements`` reads named data elements of each, ``pictures`` makes one plain record
per image frame, ``grouping`` forms series and times, ``stacking`` finds the geometry, ``pixels`` decodes voxels,
``values`` gives them their meaning, and ``reader`` runs these in order. Patients' names, numbers and dates are never
read.
"""
