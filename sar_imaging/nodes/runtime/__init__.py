"""Common parts of all nodes: parameters, life cycle, worker thread, overload, diagnostics.

A node is a `stage.Stage`: it takes messages (`inlet`), hands them to the worker thread (`worker`,
`overload`), in which a `step.Step` or several in a `chain` work on them, and tells how it fares
(`health`). `managed` is its life cycle, `parameters` what users set.
"""
