/* Light on places in shell fur, rays side by side.  march.cl uses this, and lanes.h, scatter.h, light.h and sky.h before it. */
#define STEEPER 2.0f    // cells by which light of a sky is looked up further out at the tips than at the roots: in cells it
                        // falls off that much less steeply (tests/test_shells_shadow.py)

/* Share of a light that gets through hair and body to places p over skin with normals n, where rays are `on`: `share` of
   it, if nothing is in its way. */
INLINED lanes transmittance_to(const Lighting *lighting, int i, lanes_i on, lanes3 p, lanes3 n, lanes share)
{
    if (lighting->shadows[i].body.x || lighting->shadows[i].hair.x > 0.0f) {
        const Obstacles obstacles = obstacles_of(lighting, i);
        for (int k = 0; k < LANES; ++k)
            if (LANE_I(on, k) && LANE(share, k) > 0.0f) {
                const float4 place = (float4)(LANE(p.x, k), LANE(p.y, k), LANE(p.z, k), 0.0f);
                if (obstacles.shadow.body.x)
                    LANE(share, k) *= past_body(&obstacles, place, (float4)(LANE(n.x, k), LANE(n.y, k), LANE(n.z, k), 0.0f),
                                                HAIR_STEEPEST, HAIR_BIAS(obstacles.shadow.body.y));
                if (obstacles.shadow.hair.x > 0.0f)
                    LANE(share, k) *= through_hair(&obstacles, (float2)(0.0f), place);
            }
    }
    return share;
}

/* Light of a sky on fur at places p, around hairs along t. */
ONCE lanes3 sky_on_fur(const Sky *sky, __global const float4 *cells, lanes_i on, const lanes3 *p, const lanes3 *t)
{
    lanes3 light = {F(0.0f), F(0.0f), F(0.0f)};
    for (int k = 0; k < LANES; ++k)
        if (LANE_I(on, k)) {
            const Known known = known_at(sky, cells, (float4)(LANE(p->x, k), LANE(p->y, k), LANE(p->z, k), 0.0f), false);
            const float4 its = light_around(&known, (float4)(LANE(t->x, k), LANE(t->y, k), LANE(t->z, k), 0.0f), 0.0f, -0.125f);
            LANE(light.x, k) = its.x, LANE(light.y, k) = its.y, LANE(light.z, k) = its.z;
        }
    return light;
}

/* Light from places p at heights h: t the hair's direction, n the skin's normal, slope the fur's gradient in the world, v
   the way to the eye.  It fades to the roots. */
INLINED lanes3 shade_fur(const Lighting *lighting, const Sky *sky, __global const float4 *sky_cells, const Shells *shells, lanes_i on, lanes3 p, lanes h, lanes3 t, lanes3 n,
                         lanes3 slope, lanes3 v)
{
    lanes3 sum = {F(0.0f), F(0.0f), F(0.0f)};
    for (int i = 0; i < lighting->n; ++i) {
        const Light light = lighting->lights[i];
        lanes3 l = all_lanes(-light.direction);
        lanes part = F(1.0f);
        if (light.position.w > 0.0f) {
            const lanes3 to_light = {light.position.x - p.x, light.position.y - p.y, light.position.z - p.z};
            l = unit(to_light);
            part = -dots(l, all_lanes(light.direction)) >= light.cone.x ? F(1.0f) : F(0.0f);
        }
        part = transmittance_to(lighting, i, on, p, n, part);
        const lanes3 share = fibres(shells, on, t, n, slope, l, v);
        const float4 direct = light.color;
        sum.x += part * direct.x * share.x + direct.w * shells->color.x;
        sum.y += part * direct.y * share.y + direct.w * shells->color.y;
        sum.z += part * direct.z * share.z + direct.w * shells->color.z;
    }
    if (sky->size.y) {
        const lanes3 place = plus(p, scaled(t, (h - 0.5f) * (STEEPER / sky->place.w)));
        const lanes3 light = sky_on_fur(sky, sky_cells, on, &place, &t);
        sum.x += shells->color.x * light.x;
        sum.y += shells->color.y * light.y;
        sum.z += shells->color.z * light.z;
    }
    return scaled(sum, shells->color.w + (1.0f - shells->color.w) * h);
}
