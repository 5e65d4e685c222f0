"""Zonotopes: the images of boxes under linear maps."""

from functools import cached_property
from itertools import combinations, product
from math import comb

import numpy as np
from numpy.typing import NDArray

from ca_ros.arrays import Array, BoolArray, IntArray, constant
from ca_ros.solver.polytope import PARALLEL, section

IndexArray = NDArray[np.intp]

SPANNING_MIN = 1e-9  # least singular value of unit vectors that span
SPAN_ROUNDING = 1e-12  # relative size below which a component that should be zero is rounding

TILES_MAX = 1_000_000

CHOICES_MAX = 1_000_000  # of m - 1 generators that facets are looked for among


class Zonotope:
    """The set of all ``center + generators @ s`` with -1 <= s_i <= 1.

    Its facets are parallel to the choices of m - 1 generators, so it is written as ``|normals @ (u
    - center)| <= widths`` and every query is a matrix-vector product. Raises a ValueError if the
    set has no volume, or too many facets.

    `center` (m,).  `generators` (m, n).

    - `normals` (k, m): unit normals, one for each pair of opposite facets
    - `sides` (k, n): component of each generator along each normal; zero for those that lie in the
      facet
    - `widths` (k,): distance of the facets from the centre
    """

    def __init__(self, center: Array, generators: Array) -> None:
        self.center, self.generators = constant(center), constant(generators)
        # Rows in units of their extent: torques are often smaller than forces by orders of
        # magnitude.
        self._extent = extent = np.abs(generators).sum(axis=1)
        if decomposition(generators) is None:
            raise ValueError('a zonotope needs generators that span its space')
        self.normals = facet_normals(generators / extent[:, None]) / extent
        self.normals /= np.linalg.norm(self.normals, axis=1)[:, None]
        self.sides = self.normals @ generators
        # Computed before `sides` is rounded, so that no point of the set is outside its facets.
        self.widths = np.abs(self.sides).sum(axis=1)
        self.sides[np.abs(self.sides) <= PARALLEL * np.linalg.norm(generators, axis=0)] = 0.0
        self._spans = np.abs(self.normals) @ extent
        for array in (self.normals, self.sides, self.widths):
            array.flags.writeable = False

    @property
    def facets(self) -> tuple[Array, Array]:
        """Outward unit normals (F, m) and offsets (F,): ``normals @ u <= offsets``."""
        normals = np.vstack([self.normals, -self.normals])
        return normals, np.tile(self.widths, 2) + normals @ self.center

    def margin(self, u: Array) -> Array:
        """Return the least slack (...) of points (..., m) over the facets, negative outside."""
        heights = (u - self.center) @ self.normals.T
        return (self.widths - np.abs(heights)).min(axis=-1)

    def reach(self, start: Array, ways: Array) -> Array:
        """Return the greatest t (...) for which ``start + t way`` is in the set.

        `start` (m,): in the set.  `ways` (..., m).
        """
        rates, height = ways @ self.normals.T, (start - self.center) @ self.normals.T
        slanted = self.slanted(rates, ways)
        ends = (self.widths - np.sign(rates) * height) / np.where(slanted, np.abs(rates), 1.0)
        return np.where(slanted, ends, np.inf).min(axis=-1)

    def nearest_facet(self, u: Array) -> Array:
        """Return the sign of each generator (..., n) on the facet with the least slack.

        At its end (+1 or -1), or free (0), for points (..., m).
        """
        heights = (u - self.center) @ self.normals.T
        nearest = np.argmin(self.widths - np.abs(heights), axis=-1)
        side = np.take_along_axis(np.sign(heights), nearest[..., None], axis=-1)
        return np.sign(side * self.sides[nearest]).astype(np.int8)

    def contains(self, u: Array, tolerance: float) -> BoolArray:
        """Tell which points (..., m) are in the set, up to `tolerance` in the margin."""
        return self.margin(u) >= -tolerance

    def gauge(self, u: Array) -> Array:
        """Return how far out points (..., m) are: 0 at the centre, 1 on the boundary."""
        heights = np.abs((u - self.center) @ self.normals.T)
        return np.asarray((heights / self.widths).max(axis=-1), float)

    def section(self, rows: list[int], at: Array) -> Array:
        """Return corners (k, d) of a section in some axes; `at` (m,) has the values of others."""
        size = self._extent
        fixed = np.setdiff1d(range(len(size)), rows)
        # Each axis relative to its range: a torque may be small beside a force.
        normals = np.vstack([self.normals, -self.normals]) * size
        norms = np.linalg.norm(normals, axis=1)
        normals /= norms[:, None]
        widths = np.tile(self.widths, 2) / norms
        slacks = widths - normals[:, fixed] @ ((at - self.center) / size)[fixed]
        return self.center[rows] + size[rows] * section(normals[:, rows], slacks)

    def shadow(self, rows: list[int]) -> Array:
        """Return corners (k, d) of the projection to some axes."""
        return Zonotope(self.center[rows], self.generators[rows]).vertices

    def slanted(self, rates: Array, directions: Array) -> BoolArray:
        """Tell which rates ``directions @ normals.T`` (..., k) are more than rounding errors."""
        size = np.abs(directions / self._extent).max(axis=-1)
        return np.abs(rates) > (SPAN_ROUNDING * size)[..., None] * self._spans

    @cached_property
    def tiles(self) -> tuple[Array, Array, Array]:
        """Parallelepipeds that tile the set: generators (t, m, m), centres (t, m), volumes (t,).

        For almost any cost c, the optimal bases of ``min c s`` subject to ``generators @ s = u -
        center`` and -1 <= s <= 1 do it: each u has one, and outside of it s_i is where the sign of
        its reduced cost sends it.
        """
        m, n = self.generators.shape
        if comb(n, m) > TILES_MAX:
            raise ValueError(
                f'{n} rotors and {m} axes make {comb(n, m)} tiles, more than {TILES_MAX}')
        cost = np.random.default_rng(0).standard_normal((n,))
        choices = np.array(list(combinations(range(n), m)), dtype=int)
        tiles = np.swapaxes(self.generators.T[choices], 1, 2)
        volumes = np.abs(np.linalg.det(2.0 * tiles))
        solid = volumes > 1e-12 * volumes.max()
        choices, tiles, volumes = choices[solid], tiles[solid], volumes[solid]
        prices: Array = np.linalg.solve(np.swapaxes(tiles, 1, 2), cost[choices][..., None])
        ends = -np.sign(cost - prices[:, :, 0] @ self.generators)
        np.put_along_axis(ends, choices, 0.0, axis=1)
        return tiles, self.center + ends @ self.generators.T, volumes

    @property
    def vertices(self) -> Array:
        """The vertices (V, m), in no particular order."""
        signs = _signs(self.generators / self._extent[:, None])
        return self.center + signs @ self.generators.T

    @property
    def volume(self) -> float:
        """Sum of the tiles' volumes."""
        return float(self.tiles[2].sum())

    def sample(self, rng: np.random.Generator, size: int) -> Array:
        """Draw points (size, m) uniformly by volume: a tile by its volume, then a point in it."""
        tiles, centers, volumes = self.tiles
        chosen = rng.choice(len(volumes), size=size, p=volumes / volumes.sum())
        shares = rng.uniform(-1.0, 1.0, (size, tiles.shape[1]))
        return centers[chosen] + np.einsum('sij,sj->si', tiles[chosen], shares)


def decomposition(generators: Array) -> tuple[Array, Array, Array, Array] | None:
    """Return the extent (m,) of generators (m, n), and the decomposition of each row over it.

    That is the singular value decomposition; None if they do not span their space by more than
    rounding.
    """
    extent = np.abs(generators).sum(axis=1)
    if not (extent > 0.0).all():
        return None
    left, singular, right = np.linalg.svd(generators / extent[:, None], full_matrices=False)
    spanned = len(singular) == len(generators) and singular[-1] > SPANNING_MIN
    return (extent, left, singular, right) if spanned else None


def facet_normals(generators: Array) -> Array:
    """Return the directions (k, m) orthogonal to m - 1 independent generators, each once.

    The span of each choice of generators is kept as the exterior product of unit vectors, and
    grows by one generator at a time: the length of the product is then the sine of the angle
    between the generator and the span, and choices that are not independent end there.
    """
    m = len(generators)
    if m == 1:
        return np.ones((1, 1))
    lengths = np.linalg.norm(generators, axis=0)
    vectors = (generators[:, lengths > 0.0] / lengths[lengths > 0.0]).T
    if comb(len(vectors), m - 1) > CHOICES_MAX:
        raise ValueError(
            f'the facets for {len(vectors)} rotors and {m} axes are among '
            f'{comb(len(vectors), m - 1)} choices of rotors, more than {CHOICES_MAX}'
        )
    last, spans = np.arange(len(vectors)), vectors
    for size in range(1, m - 1):
        room = len(vectors) - 1 - last
        parents = np.repeat(np.arange(len(last)), room)
        first = np.cumsum(room) - room
        last = last[parents] + 1 + np.arange(len(parents)) - first[parents]
        spans = _exterior_products(spans, parents, vectors, last, size)
        sines = np.linalg.norm(spans, axis=1)
        kept = sines > SPANNING_MIN
        last, spans = last[kept], spans[kept] / sines[kept, None]
    # The components of a product belong to choices of m - 1 axes: to the axis that is left out.
    signs = (-1.0) ** np.arange(m)
    normals = spans[:, ::-1] * signs
    leading = np.argmax(np.abs(normals) > SPANNING_MIN, axis=1)
    normals *= np.sign(normals[np.arange(len(normals)), leading])[:, None]
    # As np.unique would, but faster, and other threads may run meanwhile.
    rounded = np.round(normals, 11)
    order = np.lexsort(rounded.T)
    differs = (np.diff(rounded[order], axis=0) != 0.0).any(axis=1)
    return normals[np.sort(order[np.concatenate([[True], differs])])]


def _exterior_products(
    spans: Array, parents: IndexArray, vectors: Array, last: IndexArray, size: int
) -> Array:
    """Return the products of ``spans[parents]``, of `size` vectors each, and ``vectors[last]``."""
    m = vectors.shape[1]
    places = {axes: i for i, axes in enumerate(combinations(range(m), size))}
    products = np.zeros((len(parents), comb(m, size + 1)))
    for i, axes in enumerate(combinations(range(m), size + 1)):
        for k, axis in enumerate(axes):
            rest = places[axes[:k] + axes[k + 1 :]]
            sign = (-1.0) ** (size - k)
            products[:, i] += sign * spans[parents, rest] * vectors[last, axis]
    return products


def _signs(generators: Array) -> IntArray:
    """Return the ends (V, n) of the generators (m, n) at each vertex: -1 or 1, 0 if it is zero.

    Each vertex lies in a facet, which is a zonotope of the generators in the facet, with one
    dimension less.
    """
    m, n = generators.shape
    if m == 1:
        ends = np.sign(generators).astype(np.int8)
        return np.vstack([ends, -ends])
    lengths = np.linalg.norm(generators, axis=0)
    found = []
    for normal in facet_normals(generators):
        sides = normal @ generators
        sides[np.abs(sides) <= PARALLEL * lengths] = 0.0
        ends = np.sign(sides).astype(np.int8)
        free = np.flatnonzero((ends == 0) & (lengths > 0.0))
        if len(free) == m - 1:
            inner = np.array(list(product((-1, 1), repeat=m - 1)), dtype=np.int8)
        else:
            # The rows of the last factor are orthonormal; all but the first are in the facet.
            plane = np.linalg.svd(normal[None])[2][1:]
            inner = _signs(plane @ generators[:, free])
        corners = np.tile(ends, (len(inner), 1))
        corners[:, free] = inner
        found += [corners, -corners]
    unique: IntArray = np.unique(np.vstack(found), axis=0)
    return unique.reshape(-1, n)
