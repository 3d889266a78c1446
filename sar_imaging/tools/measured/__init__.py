"""Public measured data: loaders that write recordings, and programs that image them.

Airborne X band (AFRL Gotcha), a rail with an ultra-wideband radar (BWSI team 6), a 77 GHz radar on
a rotating arm (ArcSAR), and a 60 GHz MIMO array.
"""
