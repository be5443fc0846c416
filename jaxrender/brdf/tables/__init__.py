"""Reflectance as numbers on a grid, or as a series: what was measured, and what is made of it.

``isotropic`` ``scattered``
    a table over half and difference angles, fitted to scattered measurements
``measurements``
    values at scattered pairs, and the metrics by which a BRDF is near to them
``corrected``
    a model times such a table, where measurements differ from it
``learned``
    what measured materials have in common, as principal components
``tabulated`` ``reconstruction`` ``cells`` ``polar_isotropic``
    tables over two directions, and what is between their samples
``cell_means``
    any BRDF as means over cells, for a coefficient tree
``nearest``
    the nearest table that is reciprocal, isotropic, separable or conserves energy
``polar_nodes`` ``rgl`` ``bilinear_warp`` ``rgl_tabulation``
    tables at the nodes of polar angles; tables over warped half vectors (Dupuy and Jakob 2018),
    and any BRDF as one
``zernike`` ``zernike_fit``
    products of Zernike polynomials (T 5.7.2), fitted to scattered measurements
"""
