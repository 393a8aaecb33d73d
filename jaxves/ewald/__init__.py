"""Fast sums over all nodes of all membranes: time that grows almost like their number, in the plane and in cells.

The kernel is split into a local part, which is zero beyond a distance r_c, and a smooth rest, which is summed by FFT.

splitting       the two parts of the kernels of Laplace and Stokes, in space and in Fourier space
plans           sizes of grids and lists, chosen before compilation from a tolerance and the number of nodes
lists           which clusters of nodes are closer to one another than r_c
mesh            nodes to a grid and back
multipliers     the smooth kernels on the grid: in the plane and in a periodic cell
sums            the sums of single layers
stresslets      the sum of the Stokes double layer
"""
