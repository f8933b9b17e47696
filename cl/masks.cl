/*
 * coverage.cl once more, where pieces of strands hide each other patch by patch of a pixel: `tiles` and `pixels` are run.
 */
#define MASKS 4                            // patches of a pixel, across and down: see mask.h
#include "coverage.cl"
