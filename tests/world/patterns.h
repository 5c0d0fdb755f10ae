// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "tests/world/random.h"
#include "tests/world/texture.h"

namespace cairn {

// Pictures with the statistics of real surfaces, made from random numbers alone. Sizes in pixels.

/// 1/f noise of mean 0: `octaves` layers of smooth noise, the coarsest with cells of `cell` px (a power of
/// two), each finer one half as strong. Wraps around if the sizes are multiples of `cell`.
[[nodiscard]] Bitmap pink_noise(int width, int height, int cell, int octaves, float amplitude,
                                Random& random);

/// Dead leaves: opaque shapes over one another, number by size falling with the cube of the size; the
/// occlusions, edges and scale-invariance of natural pictures (Lee, Mumford and Huang, IJCV 2001).
[[nodiscard]] Bitmap dead_leaves(int width, int height, Random& random);

/// Something rough of nearly one value, like stone or rusty steel: noise of that amplitude, and round darker
/// chips, so many of them.
[[nodiscard]] Bitmap rough(int width, int height, float value, float amplitude, int chips, Random& random);

/// Wood with the grain along x.
[[nodiscard]] Bitmap wood(int width, int height, Random& random);

/// A printed page: heading, paragraphs, sometimes a figure or a table.
[[nodiscard]] Bitmap printed_page(int width, int height, Random& random);

/// A computer screen full of source text, with a side bar and a title bar; light letters on dark or the
/// reverse.
[[nodiscard]] Bitmap code_screen(int width, int height, bool dark_on_light, Random& random);

/// Front of a book or a product box: picture, title, small print.
[[nodiscard]] Bitmap cover(int width, int height, Random& random);

/// Back of a book, title along y.
[[nodiscard]] Bitmap spine(int width, int height, Random& random);

/// Rows of alike keys with glyphs.
[[nodiscard]] Bitmap keyboard(int width, int height, Random& random);

/// Label that goes once around a mug or tin: plain, with a sign or a line of text every half turn.
[[nodiscard]] Bitmap wrapped_label(int width, int height, float ground, Random& random);

/// Woven cloth, threads of `pitch` px; wraps around if the sizes are multiples of it.
[[nodiscard]] Bitmap fabric(int width, int height, int pitch, float value, Random& random);

/// Carpet tiles of broken stripes.
[[nodiscard]] Bitmap carpet(int width, int height, Random& random);

/// Paints a line of words of letter-like signs from x to x_end at most, top at y, `size` px high.
void draw_text_line(Bitmap* picture, float x, float y, float x_end, float size, float ink, Random& random);

/// Paints a random knot of cables with highlights, within `radius` px of (x, y).
void draw_cable_tangle(Bitmap* picture, float x, float y, float radius, float thickness, Random& random);

}  // namespace cairn
