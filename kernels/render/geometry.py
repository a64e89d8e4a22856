"""What rays hit: triangles with smooth normals, tangents and places in textures."""

import warp as wp

FAR = wp.constant(1.0e30)
LEAST_COSINE = wp.constant(1.0e-2)  # of the view to a bent normal


@wp.struct
class Geometry:
    """Triangles of `mesh`; of each vertex a unit normal, a unit tangent with the sign of v's direction, a uv.

    indices: [3 triangles]. materials: of each triangle. detail: of each triangle the log2 of a length in uv over the
    same in space, and the normal's turn in radians a unit of length, positive where it is convex. epsilon: by which
    rays start above a surface, against roundings.
    """

    mesh: wp.uint64
    points: wp.array[wp.vec3]
    indices: wp.array[int]
    normals: wp.array[wp.vec3]
    tangents: wp.array[wp.vec4]
    uvs: wp.array[wp.vec2]
    materials: wp.array[int]
    detail: wp.array[wp.vec2]
    epsilon: float


@wp.struct
class Hit:
    """x, y, z: the tangent frame, z towards the viewer. origin: where rays leave the surface."""

    found: bool
    distance: float
    origin: wp.vec3
    x: wp.vec3
    y: wp.vec3
    z: wp.vec3
    uv: wp.vec2
    material: int
    detail: wp.vec2


@wp.func
def towards(hit: Hit, direction: wp.vec3) -> wp.vec3:
    """From space to the tangent frame."""
    return wp.vec3(wp.dot(hit.x, direction), wp.dot(hit.y, direction), wp.dot(hit.z, direction))


@wp.func
def from_frame(hit: Hit, local: wp.vec3) -> wp.vec3:
    """From the tangent frame to space."""
    return wp.normalize(hit.x * local[0] + hit.y * local[1] + hit.z * local[2])


@wp.func
def above(point: wp.vec3, vertex: wp.vec3, normal: wp.vec3) -> wp.vec3:
    """The point, moved up to the tangent plane of a vertex if it is below."""
    return point - normal * wp.min(wp.dot(point - vertex, normal), 0.0)


@wp.func
def bent(normal: wp.vec3, view: wp.vec3) -> wp.vec3:
    """A smooth normal that faces the viewer, who sees the triangle: at silhouettes of coarse meshes it may not
    (as Keller et al. 2017, "The Iray Light Transport Simulation and Rendering System", bend it)."""
    cosine = wp.dot(normal, view)
    return wp.normalize(normal + view * wp.max(LEAST_COSINE - cosine, 0.0))


@wp.func
def blocked(geometry: Geometry, origin: wp.vec3, direction: wp.vec3) -> bool:
    return wp.mesh_query_ray_anyhit(geometry.mesh, origin, direction, FAR)


@wp.func
def framed(hit: Hit, normal: wp.vec3, tangent: wp.vec4) -> Hit:
    """With x along the tangent and y along v as far as both are orthogonal to the normal."""
    t = wp.vec3(tangent[0], tangent[1], tangent[2])
    x = t - normal * wp.dot(t, normal)
    if wp.length_sq(x) < 1.0e-12:
        x = wp.cross(normal, wp.where(wp.abs(normal[0]) > 0.5, wp.vec3(0.0, 1.0, 0.0), wp.vec3(1.0, 0.0, 0.0)))
    hit.z = normal
    hit.x = wp.normalize(x)
    hit.y = wp.cross(normal, hit.x) * wp.where(tangent[3] < 0.0, -1.0, 1.0)
    return hit


@wp.func
def intersect(geometry: Geometry, origin: wp.vec3, direction: wp.vec3) -> Hit:
    """The nearest surface along a ray; both sides of a triangle are alike.

    Rays leave from the smooth surface that the normals tell of, above the triangle (Hanika 2021, "Hacking the Shadow
    Terminator", Ray Tracing Gems II): from the triangle they would find its neighbours in the way, a black edge.
    """
    hit = Hit()
    ray = wp.mesh_query_ray(geometry.mesh, origin, direction, FAR)
    hit.found = ray.result
    if ray.result:
        side = wp.where(wp.dot(ray.normal, direction) > 0.0, -1.0, 1.0)
        a, b, c = geometry.indices[3 * ray.face], geometry.indices[3 * ray.face + 1], geometry.indices[3 * ray.face + 2]
        u, v, w = ray.u, ray.v, 1.0 - ray.u - ray.v
        pa, pb, pc = geometry.points[a], geometry.points[b], geometry.points[c]
        na, nb, nc = side * geometry.normals[a], side * geometry.normals[b], side * geometry.normals[c]
        point = u * pa + v * pb + w * pc
        smooth = u * above(point, pa, na) + v * above(point, pb, nb) + w * above(point, pc, nc)
        tangent = u * geometry.tangents[a] + v * geometry.tangents[b] + w * geometry.tangents[c]
        tangent[3] = tangent[3] * side  # with the normal turned, y along v needs the other sign
        hit = framed(hit, bent(wp.normalize(u * na + v * nb + w * nc), -direction), tangent)
        hit.origin = smooth + ray.normal * (side * geometry.epsilon)
        hit.uv = u * geometry.uvs[a] + v * geometry.uvs[b] + w * geometry.uvs[c]
        hit.material = geometry.materials[ray.face]
        detail = geometry.detail[ray.face]
        hit.detail = wp.vec2(detail[0], detail[1] * side)
        hit.distance = ray.t
    return hit
