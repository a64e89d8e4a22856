"""What rays hit: the ground at y = 0, y is up, and a sphere that stands on it; with places in the texture."""

import warp as wp

TEXTURES_PER_UNIT = wp.constant(0.5)  # on the ground, of the texture's sides
AROUND = wp.constant(4.0)  # times that the texture repeats around the sphere; half as often from pole to pole
CENTRE = wp.constant(wp.vec3(0.0, 1.0, 0.0))  # of the sphere, whose radius is 1
NOWHERE = wp.constant(1.0e6)  # distance of the sky


@wp.struct
class Camera:
    """right, up: unit vectors times half of the picture's extent at distance 1 along the unit vector forward."""

    eye: wp.vec3
    right: wp.vec3
    up: wp.vec3
    forward: wp.vec3


@wp.struct
class Hit:
    """along_u, along_v: of the position, by u and by v; orthogonal. texture v goes down the picture."""

    distance: float
    position: wp.vec3
    normal: wp.vec3
    along_u: wp.vec3
    along_v: wp.vec3
    uv: wp.vec2


@wp.func
def ray_of(camera: Camera, x: float, y: float, width: int, height: int) -> wp.vec3:
    """Unit vector through the point (x right, y down, in pixels) of a picture."""
    across, down = 2.0 * x / float(width) - 1.0, 2.0 * y / float(height) - 1.0
    return wp.normalize(camera.forward + camera.right * across - camera.up * down)


@wp.func
def pixel_of(camera: Camera, position: wp.vec3, width: int, height: int) -> wp.vec2:
    """Where a point in front of the camera is seen, (x, y) in pixels: the inverse of `ray_of`."""
    towards = position - camera.eye
    towards = towards / wp.dot(towards, camera.forward)
    across = wp.dot(towards, camera.right) / wp.length_sq(camera.right)
    down = -wp.dot(towards, camera.up) / wp.length_sq(camera.up)
    return wp.vec2((across + 1.0) * 0.5 * float(width), (down + 1.0) * 0.5 * float(height))


@wp.func
def sphere_distance(origin: wp.vec3, direction: wp.vec3) -> float:
    """Along a ray from outside to the sphere; NOWHERE if it misses."""
    towards = CENTRE - origin
    along = wp.dot(towards, direction)
    across = towards - direction * along
    inside = 1.0 - wp.dot(across, across)
    distance = along - wp.sqrt(wp.max(inside, 0.0))
    return wp.where(inside > 0.0 and distance > 0.0, distance, NOWHERE)


@wp.func
def normal_at(position: wp.vec3) -> wp.vec3:
    """Of the surface that a place is on."""
    from_centre = position - CENTRE
    return wp.where(wp.length(from_centre) < 1.001, from_centre, wp.vec3(0.0, 1.0, 0.0))


@wp.func
def intersect(origin: wp.vec3, direction: wp.vec3) -> Hit:
    hit = Hit()
    hit.distance = sphere_distance(origin, direction)
    hit.position = origin + direction * NOWHERE
    ground = wp.where(direction[1] < 0.0, -origin[1] / wp.min(direction[1], -1.0e-6), NOWHERE)
    if ground < hit.distance:
        hit.distance = ground
        hit.position = origin + direction * ground
        hit.normal = wp.vec3(0.0, 1.0, 0.0)
        hit.uv = wp.vec2(hit.position[0], hit.position[2]) * TEXTURES_PER_UNIT
        hit.along_u = wp.vec3(1.0 / TEXTURES_PER_UNIT, 0.0, 0.0)
        hit.along_v = wp.vec3(0.0, 0.0, 1.0 / TEXTURES_PER_UNIT)
    elif hit.distance < NOWHERE:
        hit.position = origin + direction * hit.distance
        n = hit.position - CENTRE
        turn, fall = wp.atan2(n[0], n[2]), wp.acos(wp.clamp(n[1], -1.0, 1.0))
        sine = wp.max(wp.sin(fall), 1.0e-3)
        hit.normal = n
        hit.uv = wp.vec2(turn / (2.0 * wp.pi) * AROUND, fall / wp.pi * 0.5 * AROUND)
        hit.along_u = wp.vec3(wp.cos(turn), 0.0, -wp.sin(turn)) * (sine * 2.0 * wp.pi / AROUND)
        hit.along_v = wp.vec3(n[1] * wp.sin(turn), -sine, n[1] * wp.cos(turn)) * (2.0 * wp.pi / AROUND)
    return hit


@wp.func
def uv_along(hit: Hit, eye: wp.vec3, direction: wp.vec3) -> wp.vec2:
    """From the hit to where a neighbouring pixel's ray meets the tangent plane (Igehy 1999, section 3.1), in uv."""
    slope = wp.dot(direction, hit.normal)
    distance = wp.dot(hit.position - eye, hit.normal) / wp.min(slope, -1.0e-4)
    offset = eye + direction * distance - hit.position
    return wp.vec2(
        wp.dot(offset, hit.along_u) / wp.length_sq(hit.along_u), wp.dot(offset, hit.along_v) / wp.length_sq(hit.along_v)
    )
