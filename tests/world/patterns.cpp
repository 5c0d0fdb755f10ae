// SPDX-License-Identifier: Apache-2.0
#include "tests/world/patterns.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <vector>

namespace cairn {
namespace {

constexpr float kTwoPi = 2 * std::numbers::pi_v<float>;

float smooth_step(float t) {
  return t * t * (3.0F - 2.0F * t);
}

/// Adds one layer of smooth noise in [-amplitude, amplitude], cells of `cell_x` by `cell_y` px.
void add_noise(Bitmap* picture, int cell_x, int cell_y, float amplitude, Random& random) {
  const int columns = std::max(picture->width() / cell_x, 1);
  const int rows = std::max(picture->height() / cell_y, 1);
  Bitmap lattice(columns, rows);
  for (int y = 0; y < rows; ++y) {
    for (int x = 0; x < columns; ++x) lattice.at(x, y) = random.uniform(-amplitude, amplitude);
  }
  for (int y = 0; y < picture->height(); ++y) {
    const int row = y / cell_y % rows;
    const int below = (row + 1) % rows;
    const float fy = smooth_step(static_cast<float>(y % cell_y) / static_cast<float>(cell_y));
    for (int x = 0; x < picture->width(); ++x) {
      const int column = x / cell_x % columns;
      const int right = (column + 1) % columns;
      const float fx = smooth_step(static_cast<float>(x % cell_x) / static_cast<float>(cell_x));
      const float top = std::lerp(lattice.at(column, row), lattice.at(right, row), fx);
      const float bottom = std::lerp(lattice.at(column, below), lattice.at(right, below), fx);
      picture->at(x, y) += std::lerp(top, bottom, fy);
    }
  }
}

void add(Bitmap* picture, const Bitmap& other) {
  for (int y = 0; y < picture->height(); ++y) {
    for (int x = 0; x < picture->width(); ++x) picture->at(x, y) += other.at(x, y);
  }
}

/// A letter-like sign of two to four strokes in a box of width 0.6 and height 1: stems, bars, bowls.
void draw_glyph(Bitmap* picture, float x, float y, float size, float ink, Random& random) {
  static constexpr std::array<std::array<float, 4>, 10> kStrokes = {{{0, 0, 0, 1},
                                                                     {1, 0, 1, 1},
                                                                     {0.5F, 0, 0.5F, 1},
                                                                     {0, 0, 1, 0},
                                                                     {0, 1, 1, 1},
                                                                     {0, 0.5F, 1, 0.5F},
                                                                     {0, 0, 1, 1},
                                                                     {1, 0, 0, 1},
                                                                     {0, 0.5F, 0, 1},
                                                                     {1, 0.5F, 1, 1}}};
  const int count = random.integer(2, 3);
  const float radius = std::max(0.07F * size, 0.45F);
  for (int i = 0; i < count; ++i) {
    const auto& s = kStrokes[static_cast<size_t>(random.integer(0, static_cast<int>(kStrokes.size()) - 1))];
    picture->stroke(x + 0.5F * size * s[0], y + size * s[1], x + 0.5F * size * s[2], y + size * s[3], radius,
                    ink);
  }
}

}  // namespace

void draw_text_line(Bitmap* picture, float x, float y, float x_end, float size, float ink, Random& random) {
  const float advance = 0.72F * size;
  while (x + 2 * advance < x_end) {
    const int letters = random.integer(1, 9);
    for (int i = 0; i < letters && x + advance < x_end; ++i) {
      draw_glyph(picture, x, y, random.chance(0.6) ? size : 0.75F * size, ink, random);
      x += advance;
    }
    x += 0.8F * advance;
  }
}

namespace {

void draw_paragraph(Bitmap* picture, float x, float y, float x_end, int lines, float size, float ink,
                    Random& random) {
  for (int line = 0; line < lines; ++line) {
    const float end = line + 1 == lines ? x + (x_end - x) * random.uniform(0.2F, 0.9F) : x_end;
    draw_text_line(picture, x, y + 2.0F * size * static_cast<float>(line), end, size, ink, random);
  }
}

}  // namespace

Bitmap pink_noise(int width, int height, int cell, int octaves, float amplitude, Random& random) {
  Bitmap picture(width, height);
  for (int octave = 0; octave < octaves && cell >= 1; ++octave) {
    add_noise(&picture, cell, cell, amplitude, random);
    cell /= 2;
    amplitude /= 2;
  }
  return picture;
}

Bitmap dead_leaves(int width, int height, Random& random) {
  Bitmap picture(width, height, random.uniform(0.2F, 0.7F));
  const auto size = static_cast<float>(std::min(width, height));
  const float smallest = 0.04F * size;
  const float largest = 0.3F * size;
  const int count = 1500;
  for (int i = 0; i < count; ++i) {
    // Density of radii ~ r^-3 between the bounds, by inversion.
    const auto t = static_cast<float>(random.unit());
    const float inverse_square = std::lerp(1 / (largest * largest), 1 / (smallest * smallest), t);
    const float radius = 1 / std::sqrt(inverse_square);
    const float x = random.uniform(0.0F, static_cast<float>(width));
    const float y = random.uniform(0.0F, static_cast<float>(height));
    const auto value = static_cast<float>(std::clamp(0.45 + 0.18 * random.normal(), 0.03, 0.97));
    switch (random.integer(0, 2)) {
      case 0:
        picture.fill_disc(x, y, radius, value);
        break;
      case 1:
        picture.fill_rectangle(x - radius, y - radius * random.uniform(0.3F, 1.0F), x + radius,
                               y + radius * random.uniform(0.3F, 1.0F), value);
        break;
      default: {
        const float angle = random.uniform(0.0F, kTwoPi);
        picture.stroke(x, y, x + 2 * radius * std::cos(angle), y + 2 * radius * std::sin(angle),
                       0.35F * radius, value);
      }
    }
  }
  add(&picture, pink_noise(width, height, 32, 5, 0.03F, random));
  picture.clamp();
  return picture;
}

Bitmap rough(int width, int height, float value, float amplitude, int chips, Random& random) {
  Bitmap picture = pink_noise(width, height, std::min(64, std::min(width, height)), 6, amplitude, random);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) picture.at(x, y) += value;
  }
  for (int chip = 0; chip < chips; ++chip) {
    const float x = random.uniform(0.0F, static_cast<float>(width));
    const float y = random.uniform(0.0F, static_cast<float>(height));
    const float radius = random.uniform(0.8F, 3.2F);
    picture.fill_disc(x, y, radius, value * random.uniform(0.3F, 0.8F));
  }
  picture.clamp();
  return picture;
}

Bitmap wood(int width, int height, Random& random) {
  Bitmap warp(width, height);
  add_noise(&warp, 512, 64, 5.0F, random);
  add_noise(&warp, 256, 32, 1.2F, random);
  Bitmap picture(width, height, 0.6F);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const float ring = static_cast<float>(y) / 42.0F + warp.at(x, y);
      const float position = ring - std::floor(ring);
      picture.at(x, y) -= 0.07F * position * position;
    }
  }
  add_noise(&picture, 128, 4, 0.02F, random);
  add_noise(&picture, 64, 2, 0.02F, random);
  add_noise(&picture, 256, 128, 0.04F, random);
  const int pores = width * height / 2500;
  for (int i = 0; i < pores; ++i) {
    const float x = random.uniform(0.0F, static_cast<float>(width));
    const float y = random.uniform(0.0F, static_cast<float>(height));
    picture.stroke(x, y, x + random.uniform(4.0F, 22.0F), y + random.uniform(-0.7F, 0.7F), 0.4F,
                   random.uniform(0.36F, 0.5F));
  }
  const int knots = 7;
  for (int i = 0; i < knots; ++i) {
    const float x = random.uniform(0.0F, static_cast<float>(width));
    const float y = random.uniform(0.0F, static_cast<float>(height));
    for (float radius = random.uniform(7.0F, 16.0F); radius > 1; radius -= 2.5F) {
      picture.fill_disc(x, y, radius, random.uniform(0.25F, 0.45F));
    }
  }
  picture.clamp();
  return picture;
}

Bitmap printed_page(int width, int height, Random& random) {
  Bitmap page(width, height, 0.87F);
  add(&page, pink_noise(width, height, 128, 3, 0.015F, random));
  const auto w = static_cast<float>(width);
  const auto h = static_cast<float>(height);
  const float margin = 0.09F * w;
  const float ink = random.uniform(0.15F, 0.35F);
  const float body_ink = random.uniform(0.45F, 0.6F);  // thin strokes do not print black
  const float size = random.uniform(0.013F, 0.022F) * h;
  float y = 0.07F * h;
  draw_text_line(&page, margin, y, w * random.uniform(0.4F, 0.8F), 0.04F * h, ink, random);
  y += 0.09F * h;
  while (y < 0.84F * h) {
    if (random.chance(0.25) && y < 0.65F * h) {
      const int figure_height = height / 5;
      Bitmap figure = dead_leaves(static_cast<int>(w - 2 * margin), figure_height, random);
      page.paste(figure, static_cast<int>(margin), static_cast<int>(y));
      y += static_cast<float>(figure_height) + 1.5F * size;
    } else {
      const int lines = std::min(random.integer(2, 7), static_cast<int>((0.95F * h - y) / (2 * size)));
      draw_paragraph(&page, margin, y, w - margin, lines, size, body_ink, random);
      y += 2 * size * (static_cast<float>(lines) + 1.5F);
    }
  }
  page.clamp();
  return page;
}

Bitmap code_screen(int width, int height, bool dark_on_light, Random& random) {
  const auto tone = [dark_on_light](float value) { return dark_on_light ? 0.95F - value : value; };
  Bitmap screen(width, height, tone(0.13F));
  const auto w = static_cast<float>(width);
  const auto h = static_cast<float>(height);
  screen.fill_rectangle(0, 0, w, 0.05F * h, tone(0.45F));
  draw_text_line(&screen, 6, 0.012F * h, 0.4F * w, 0.026F * h, tone(0.9F), random);
  const float side_bar = 0.16F * w;
  screen.fill_rectangle(0, 0.05F * h, side_bar, h, tone(0.22F));
  const float size = 0.024F * h;
  int indent = 0;
  for (float y = 0.07F * h; y < 0.95F * h; y += 2.2F * size) {
    if (random.chance(0.35)) {
      draw_text_line(&screen, 8, y, side_bar * random.uniform(0.4F, 0.9F), size, tone(0.4F), random);
    }
    if (random.chance(0.2)) continue;  // an empty line
    indent = std::clamp(indent + random.integer(-1, 1), 0, 5);
    const float x = side_bar + (0.02F + 0.03F * static_cast<float>(indent)) * w;
    draw_text_line(&screen, x, y, x + random.uniform(0.06F, 0.32F) * w, size,
                   tone(random.uniform(0.3F, 0.6F)), random);
  }
  return screen;
}

Bitmap cover(int width, int height, Random& random) {
  const auto w = static_cast<float>(width);
  const auto h = static_cast<float>(height);
  const float ground = random.uniform(0.1F, 0.85F);
  const float ink = ground > 0.5F ? random.uniform(0.02F, 0.2F) : random.uniform(0.8F, 0.98F);
  Bitmap front(width, height, ground);
  add(&front, pink_noise(width, height, std::min(width, 128), 4, 0.03F, random));
  draw_text_line(&front, 0.08F * w, 0.06F * h, 0.95F * w, 0.09F * h, ink, random);
  draw_text_line(&front, 0.08F * w, 0.2F * h, 0.8F * w, 0.04F * h, ink, random);
  const Bitmap picture = dead_leaves(width * 3 / 4, height * 2 / 5, random);
  front.paste(picture, width / 8, height * 3 / 10);
  draw_paragraph(&front, 0.1F * w, 0.76F * h, 0.9F * w, 3, 0.026F * h, std::lerp(ground, ink, 0.4F), random);
  draw_text_line(&front, 0.5F * w, 0.92F * h, 0.95F * w, 0.035F * h, ink, random);
  front.clamp();
  return front;
}

Bitmap spine(int width, int height, Random& random) {
  const float ground = random.uniform(0.08F, 0.8F);
  const float ink = ground > 0.45F ? 0.08F : 0.92F;
  Bitmap sideways(height, width, ground);  // painted lying, then turned upright
  const auto length = static_cast<float>(height);
  const auto thickness = static_cast<float>(width);
  draw_text_line(&sideways, 0.12F * length, 0.25F * thickness, 0.8F * length, 0.45F * thickness, ink, random);
  sideways.fill_rectangle(0.03F * length, 0, 0.05F * length, thickness, ink);
  sideways.fill_rectangle(0.88F * length, 0.2F * thickness, 0.94F * length, 0.8F * thickness, ink);
  Bitmap upright(width, height);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) upright.at(x, y) = sideways.at(y, width - 1 - x);
  }
  add(&upright, pink_noise(width, height, std::min(width, 32), 3, 0.02F, random));
  upright.clamp();
  return upright;
}

Bitmap keyboard(int width, int height, Random& random) {
  constexpr int kRows = 6;
  constexpr int kColumns = 19;
  Bitmap board(width, height, 0.10F);
  const float key_width = 0.97F * static_cast<float>(width) / kColumns;
  const float key_height = 0.92F * static_cast<float>(height) / kRows;
  for (int row = 0; row < kRows; ++row) {
    for (int column = 0; column < kColumns; ++column) {
      if (column == 15) continue;  // gap before the number pad
      const float x = 0.015F * static_cast<float>(width) + static_cast<float>(column) * key_width;
      const float y = 0.04F * static_cast<float>(height) + static_cast<float>(row) * key_height;
      board.fill_rectangle(x + 1.5F, y + 2, x + key_width - 1.5F, y + key_height - 2, 0.24F);
      board.fill_rectangle(x + 3.5F, y + 3, x + key_width - 3.5F, y + key_height - 6, 0.31F);
      if (random.chance(0.3)) continue;
      draw_glyph(&board, x + 0.28F * key_width, y + 0.25F * key_height, 0.36F * key_height, 0.5F, random);
    }
  }
  return board;
}

Bitmap wrapped_label(int width, int height, float ground, Random& random) {
  const auto w = static_cast<float>(width);
  const auto h = static_cast<float>(height);
  const float ink = ground > 0.5F ? 0.12F : 0.85F;
  Bitmap label(width, height, ground);
  add(&label, pink_noise(width, height, 64, 2, 0.012F, random));
  for (const float x : {0.0F, 0.5F * w}) {
    const float band = random.uniform(0.3F, 0.45F) * h;
    draw_text_line(&label, x + 0.06F * w, band, x + 0.42F * w, 0.14F * h, ink, random);
    label.fill_disc(x + 0.12F * w, 0.75F * h, 0.09F * h, ink);
    draw_paragraph(&label, x + 0.2F * w, 0.66F * h, x + 0.43F * w, 2, 0.06F * h, ink, random);
  }
  label.fill_rectangle(0, 0.06F * h, w, 0.1F * h, ink);
  label.clamp();
  return label;
}

Bitmap fabric(int width, int height, int pitch, float value, Random& random) {
  Bitmap cloth(width, height, value);
  add(&cloth, pink_noise(width, height, 128, 6, 0.08F, random));
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const bool warp_on_top = (x / pitch + y / pitch) % 2 == 0;
      const float across = static_cast<float>((warp_on_top ? x : y) % pitch) / static_cast<float>(pitch);
      cloth.at(x, y) += 0.05F * std::sin(0.5F * kTwoPi * across) - 0.03F;
    }
  }
  cloth.clamp();
  return cloth;
}

Bitmap carpet(int width, int height, Random& random) {
  Bitmap floor(width, height, 0.3F);
  constexpr int kTile = 128;
  for (int y0 = 0; y0 < height; y0 += kTile) {
    for (int x0 = 0; x0 < width; x0 += kTile) {
      const bool along = (x0 / kTile + y0 / kTile) % 2 == 0;
      for (int stripe = 0; stripe < kTile;) {
        const int thickness = random.integer(2, 7);
        const float value = random.uniform(0.15F, 0.5F);
        for (int i = stripe; i < std::min(stripe + thickness, kTile); ++i) {
          for (int j = 0; j < kTile; ++j) floor.at(x0 + (along ? i : j), y0 + (along ? j : i)) = value;
        }
        stripe += thickness;
      }
    }
  }
  add(&floor, pink_noise(width, height, 16, 4, 0.07F, random));
  floor.clamp();
  return floor;
}

void draw_cable_tangle(Bitmap* picture, float x, float y, float radius, float thickness, Random& random) {
  const int cables = random.integer(3, 5);
  for (int cable = 0; cable < cables; ++cable) {
    const float tone = random.chance(0.6) ? random.uniform(0.05F, 0.15F) : random.uniform(0.7F, 0.85F);
    // A point on two turning circles: loops that wander.
    const float slow = random.uniform(0.6F, 1.4F);
    const float fast = random.uniform(2.0F, 3.6F);
    const float phase = random.uniform(0.0F, kTwoPi);
    constexpr int kSteps = 160;
    const auto point = [&](int step) {
      const float t = kTwoPi * static_cast<float>(step) / kSteps;
      return std::array<float, 2>{
          x + radius * (0.6F * std::cos(slow * t + phase) + 0.4F * std::cos(fast * t)),
          y + radius * (0.6F * std::sin(slow * t) + 0.4F * std::sin(fast * t + phase))};
    };
    for (int step = 0; step < kSteps; ++step) {
      const auto from = point(step);
      const auto to = point(step + 1);
      picture->stroke(from[0], from[1] + 0.6F * thickness, to[0], to[1] + 0.6F * thickness, thickness, 0.3F);
      picture->stroke(from[0], from[1], to[0], to[1], thickness, tone);
      picture->stroke(from[0], from[1] - 0.4F * thickness, to[0], to[1] - 0.4F * thickness, 0.2F * thickness,
                      tone + 0.15F);
    }
  }
}

}  // namespace cairn
