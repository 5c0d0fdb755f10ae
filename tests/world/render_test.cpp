// SPDX-License-Identifier: Apache-2.0
#include "tests/world/render.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <numbers>
#include <vector>

#include "tests/world/random.h"

namespace cairn {
namespace {

constexpr double kWallDepth = 1.0;  // m

CameraPtr test_camera() {
  return make_camera(
             {CameraModel::kPinholeRadtan, 640, 480, {480, 482, 322.3, 237.1, -0.2, 0.05, 1e-3, -5e-4, 0}})
      .value();
}

/// A wide picture square to the axis at kWallDepth; map and camera axes coincide at the identity pose.
/// `per_metre` texels; the picture's middle lies on the axis.
Scenario wall_scenario(const Bitmap& picture, double per_metre) {
  Scenario scenario;
  scenario.camera = test_camera();
  scenario.textures.emplace_back(picture);
  const double w = picture.width() / per_metre;
  const double h = picture.height() / per_metre;
  const TextureRegion region{0, 0, 0, static_cast<double>(picture.width()),
                             static_cast<double>(picture.height())};
  // Seen along +z with y down: right is +x, up is -y.
  scenario.faces.push_back(make_face({-w / 2, h / 2, kWallDepth}, {w, 0, 0}, {0, -h, 0}, region, 1.0F));
  return scenario;
}

GrayImage render(const Scenario& scenario, const CameraPath& path, const Exposure& exposure) {
  Renderer renderer(scenario);
  GrayImage image;
  renderer.render(path, exposure, &image);
  return image;
}
GrayImage render_still(const Scenario& scenario, const SE3& camera_from_map, const Exposure& exposure = {}) {
  return render(
      scenario, [&](double) { return camera_from_map; }, exposure);
}

/// Centroid of what is brighter than the black ground, within `half` px of a place.
Eigen::Vector2d bright_centroid(const GrayImage& image, const Eigen::Vector2d& about, int half) {
  Eigen::Vector2d sum = Eigen::Vector2d::Zero();
  double weight = 0;
  const int x0 = static_cast<int>(std::lround(about.x()));
  const int y0 = static_cast<int>(std::lround(about.y()));
  for (int y = y0 - half; y <= y0 + half; ++y) {
    for (int x = x0 - half; x <= x0 + half; ++x) {
      sum += image.row(y)[x] * Eigen::Vector2d(x, y);
      weight += image.row(y)[x];
    }
  }
  return sum / weight;
}

double mean_of(const GrayImage& image) {
  double sum = 0;
  for (int y = 0; y < image.height(); ++y) {
    for (int x = 0; x < image.width(); ++x) sum += image.row(y)[x];
  }
  return sum / (image.width() * image.height());
}

bool same(const GrayImage& a, const GrayImage& b) {
  if (a.width() != b.width() || a.height() != b.height()) return false;
  for (int y = 0; y < a.height(); ++y) {
    if (std::memcmp(a.row(y), b.row(y), static_cast<size_t>(a.width())) != 0) return false;
  }
  return true;
}

SE3 tilted(double scale) {
  return {so3_exp(scale * Eigen::Vector3d(0.12, -0.09, 0.3)), scale * Eigen::Vector3d(0.04, -0.03, 0.1)};
}

TEST(Renderer, DotsLieWhereTheCameraProjectsThem) {
  // White discs of 12 mm on black: small enough for the perspective of their outline not to matter, large
  // enough for a centroid over several pixels.
  constexpr double kPerMetre = 1000;
  Bitmap picture(2048, 2048, 0.0F);
  std::vector<Eigen::Vector3d> centres;
  for (int row = -5; row <= 5; ++row) {
    for (int column = -7; column <= 7; ++column) {
      const Eigen::Vector3d centre(0.09 * column, 0.09 * row, kWallDepth);
      centres.push_back(centre);
      // The centre of texel i lies at i + 0.5 of the region.
      picture.fill_disc(static_cast<float>(1023.5 + kPerMetre * centre.x()),
                        static_cast<float>(1023.5 + kPerMetre * centre.y()), 6, 1.0F);
    }
  }
  const Scenario scenario = wall_scenario(picture, kPerMetre);
  for (const double tilt : {0.0, 1.0}) {
    const SE3 camera_from_map = tilted(tilt);
    const GrayImage image = render_still(scenario, camera_from_map);
    int compared = 0;
    double squares = 0;
    for (const Eigen::Vector3d& centre : centres) {
      const auto pixel = scenario.camera->project(camera_from_map * centre);
      if (!pixel || !scenario.camera->in_image(*pixel, 12)) continue;
      const double error = (bright_centroid(image, *pixel, 9) - *pixel).norm();
      EXPECT_LT(error, 0.05) << "at pixel " << pixel->transpose() << ", tilt " << tilt;
      squares += error * error;
      ++compared;
    }
    EXPECT_GE(compared, 60);
    EXPECT_LT(std::sqrt(squares / compared), 0.03);
  }
}

TEST(Renderer, EdgeOfAFaceLiesWhereTheCameraProjectsIt) {
  // The outline itself, not texture: the sum of grey values along a row tells where the edge crosses it.
  Scenario scenario = wall_scenario(Bitmap(8, 8, 0.8F), 8 / 0.5);
  const GrayImage image = render_still(scenario, SE3());
  double error_sum = 0;
  int rows = 0;
  for (double y = -0.2; y <= 0.2; y += 0.01) {
    const Eigen::Vector2d left = scenario.camera->project({-0.25, y, kWallDepth}).value();
    const int row = static_cast<int>(std::lround(left.y()));
    // The edge of the same face at the height of the pixel row's centre.
    const Eigen::Vector3d ray = scenario.camera->unproject({left.x(), static_cast<double>(row)});
    const double expected =
        scenario.camera->project({-0.25, ray.y() / ray.z() * kWallDepth, kWallDepth})->x();
    double covered = 0;
    const int x0 = static_cast<int>(expected) - 10;
    for (int x = x0; x <= x0 + 20; ++x) covered += image.row(row)[x] / 204.0;
    const double edge = x0 + 20.5 - covered;            // pixels reach half a pixel around their centres
    EXPECT_NEAR(edge, expected, 0.3) << "row " << row;  // four samples: a quarter of a pixel in one row
    error_sum += edge - expected;
    ++rows;
  }
  EXPECT_NEAR(error_sum / rows, 0, 0.05);
}

TEST(Renderer, NearFaceHidesFarFaceAndBackIsUnseen) {
  Scenario scenario = wall_scenario(Bitmap(8, 8, 0.2F), 8 / 4.0);
  scenario.textures.emplace_back(Bitmap(8, 8, 0.8F));
  const TextureRegion bright{1, 0, 0, 8, 8};
  const Face front = make_face({-0.1, 0.1, 0.7}, {0.2, 0, 0}, {0, -0.2, 0}, bright, 1.0F);
  const Face behind = make_face({-0.1, 0.1, 1.3}, {0.2, 0, 0}, {0, -0.2, 0}, bright, 1.0F);
  const Face back = make_face({0.1, 0.1, 0.7}, {-0.2, 0, 0}, {0, -0.2, 0}, bright, 1.0F);
  for (const auto& [face, grey] : {std::pair{front, 204}, {behind, 51}, {back, 51}}) {
    Scenario with = scenario;
    with.faces.push_back(face);
    const GrayImage image = render_still(with, SE3());
    EXPECT_EQ(image.row(237)[322], grey);
    EXPECT_EQ(image.row(40)[40], 51);
  }
}

TEST(Renderer, FaceThatReachesBehindTheCameraIsSeenWhole) {
  Scenario scenario;
  scenario.camera = test_camera();
  scenario.textures.emplace_back(Bitmap(8, 8, 0.8F));
  // A floor one metre below, from 5 m behind to 50 m ahead.
  scenario.faces.push_back(make_face({-50, 1, -5}, {100, 0, 0}, {0, 0, 55}, {0, 0, 0, 8, 8}, 1.0F));
  ASSERT_LT(scenario.faces[0].normal.y(), 0);
  const GrayImage image = render_still(scenario, SE3());
  for (int x = 5; x < 640; x += 90) {
    EXPECT_EQ(image.row(470)[x], 204);
    EXPECT_EQ(image.row(260)[x], 204);
    EXPECT_EQ(image.row(100)[x], 0) << "above the horizon";
  }
}

TEST(Renderer, FineTextureFadesToItsMeanWithDistance) {
  // One-texel checkerboard: seen from afar it must be grey, not moire.
  Bitmap checkers(1024, 1024);
  for (int y = 0; y < 1024; ++y) {
    for (int x = 0; x < 1024; ++x) checkers.at(x, y) = (x + y) % 2 == 0 ? 1.0F : 0.0F;
  }
  const GrayImage image = render_still(wall_scenario(checkers, 2000), tilted(1.0));
  double deviation = 0;
  for (int y = 220; y < 260; ++y) {
    for (int x = 300; x < 340; ++x) deviation = std::max(deviation, std::abs(image.row(y)[x] - 127.5));
  }
  EXPECT_LT(deviation, 12);
}

TEST(Renderer, NoiseHasTheStatedSigmaAndIsWhite) {
  const Scenario scenario = wall_scenario(Bitmap(8, 8, 0.5F), 1);
  for (const double sigma : {1.0, 5.0}) {
    Exposure exposure;
    exposure.noise_sigma = sigma;
    exposure.noise_key = 77;
    const GrayImage image = render_still(scenario, SE3(), exposure);
    const double mean = mean_of(image);
    EXPECT_NEAR(mean, 128, 0.05);
    double variance = 0;
    double neighbours = 0;
    double below = 0;
    for (int y = 0; y + 1 < image.height(); ++y) {
      for (int x = 0; x + 1 < image.width(); ++x) {
        const double here = image.row(y)[x] - mean;
        variance += here * here;
        neighbours += here * (image.row(y)[x + 1] - mean);
        below += here * (image.row(y + 1)[x] - mean);
      }
    }
    const double count = 639.0 * 479.0;
    EXPECT_NEAR(variance / count, sigma * sigma + 1.0 / 12, 0.02 * sigma * sigma);  // rounding adds 1/12
    EXPECT_NEAR(neighbours / variance, 0, 0.01);
    EXPECT_NEAR(below / variance, 0, 0.01);
    exposure.noise_key = 78;
    EXPECT_FALSE(same(image, render_still(scenario, SE3(), exposure)));
  }
}

TEST(Renderer, GainScalesAndClips) {
  const Scenario scenario = wall_scenario(Bitmap(8, 8, 0.4F), 1);
  for (const double gain : {0.5, 1.0, 1.7, 4.0}) {
    Exposure exposure;
    exposure.gain = gain;
    EXPECT_EQ(render_still(scenario, SE3(), exposure).row(200)[300],
              static_cast<int>(std::min(102 * gain + 0.5, 255.0)));
  }
}

TEST(Renderer, VignettingFollowsTheCosineLaw) {
  Scenario scenario = wall_scenario(Bitmap(8, 8, 0.8F), 1);
  scenario.vignetting = 1;
  const GrayImage image = render_still(scenario, SE3());
  for (const Eigen::Vector2i& pixel : {Eigen::Vector2i(322, 237), {10, 10}, {600, 100}, {320, 470}}) {
    const double cosine = scenario.camera->unproject(pixel.cast<double>()).z();
    EXPECT_NEAR(image.row(pixel.y())[pixel.x()], 204 * std::pow(cosine, 4), 0.6);
  }
}

/// A white bar on black, x = 0, wide enough to be whole; its profile along the middle row.
Scenario bar_scenario() {
  Bitmap picture(1024, 64, 0.0F);
  picture.fill_rectangle(501.5F, -1, 521.5F, 64, 1.0F);
  return wall_scenario(picture, 1000);
}

double profile_spread(const GrayImage& image, double* centre) {
  double sum = 0;
  double first = 0;
  double second = 0;
  for (int x = 0; x < image.width(); ++x) {
    const double weight = image.row(237)[x];
    sum += weight;
    first += weight * x;
    second += weight * x * x;
  }
  *centre = first / sum;
  return std::sqrt(second / sum - *centre * *centre);
}

TEST(Renderer, MotionBlursSymmetricallyByTheShutter) {
  const Scenario scenario = bar_scenario();
  const double speed = 0.6;  // m/s, parallel to the wall: 288 px/s
  const CameraPath path = [speed](double t) {
    return SE3(Eigen::Quaterniond::Identity(), Eigen::Vector3d(speed * t, 0, 0));
  };
  double still_centre = 0;
  const double still = profile_spread(render(scenario, path, {}), &still_centre);
  double last = still;
  for (const double shutter : {0.01, 0.02, 0.04}) {
    Exposure exposure;
    exposure.shutter = shutter;
    double centre = 0;
    const double spread = profile_spread(render(scenario, path, exposure), &centre);
    // Variances of independent spreads add; that of a box of length L is L^2 / 12.
    const double length = 480 * speed * shutter;
    EXPECT_NEAR(spread, std::sqrt(still * still + length * length / 12), 0.1) << shutter;
    EXPECT_NEAR(centre, still_centre, 0.05) << "the truth is the middle of the exposure";
    EXPECT_GT(spread, last);
    last = spread;
  }
}

TEST(Renderer, RollingShutterSkewsAboutTheMiddleRow) {
  Bitmap picture(1024, 1024, 0.0F);
  picture.fill_rectangle(501.5F, -1, 521.5F, 1024, 1.0F);
  Scenario scenario = wall_scenario(picture, 1000);
  scenario.camera =
      make_camera({CameraModel::kPinholeRadtan, 640, 480, {480, 480, 320, 240, 0, 0, 0, 0, 0}}).value();
  Exposure exposure;
  exposure.readout = 0.03;
  const double speed = 0.6;
  const GrayImage image = render(
      scenario,
      [speed](double t) { return SE3(Eigen::Quaterniond::Identity(), Eigen::Vector3d(speed * t, 0, 0)); },
      exposure);
  for (int y = 20; y < 460; y += 40) {
    double sum = 0;
    double first = 0;
    for (int x = 0; x < 640; ++x) {
      sum += image.row(y)[x];
      first += image.row(y)[x] * x;
    }
    const double seconds = exposure.readout * ((y + 0.5) / 480 - 0.5);
    // A row of tiles shares one time: half a tile's rows of error.
    EXPECT_NEAR(first / sum, 320 + 480 * speed * seconds, 480 * speed * exposure.readout * 4 / 480 + 0.05)
        << y;
  }
}

TEST(TileKernels, AllProcessorsGiveTheSameBytes) {
  Random random(5);
  const uint64_t seed = 5;
  Bitmap picture(64, 64);
  for (int y = 0; y < 64; ++y) {
    for (int x = 0; x < 64; ++x) picture.at(x, y) = random.uniform(0.0F, 1.0F);
  }
  const Texture texture(picture);
  const IdealBox view{-1, -1, 1, 1};
  std::vector<ProjectedFace> projected;
  for (int i = 0; i < 40; ++i) {
    const Eigen::Vector3d origin(random.uniform(-0.8, 0.5), random.uniform(-0.5, 0.8),
                                 random.uniform(0.6, 2.0));
    const Face face =
        make_face(origin, {random.uniform(0.1, 0.9), 0, random.uniform(-0.3, 0.3)},
                  {0, -random.uniform(0.1, 0.9), random.uniform(-0.3, 0.3)}, {0, 0, 0, 64, 64}, 0.9F);
    if (const auto p = project_face(face, texture, SE3(), view)) projected.push_back(*p);
  }
  ASSERT_GT(projected.size(), 20U);
  std::vector<TileFace> faces;
  for (const ProjectedFace& face : projected) faces.push_back({&face, (1U << face.edge_count) - 1});
  TileRays rays;
  for (size_t i = 0; i < kTilePixels; ++i) {
    rays.x[i] = -0.4F + 0.025F * static_cast<float>(i % kTileWidth);
    rays.y[i] = -0.3F + 0.07F * static_cast<float>(i / kTileWidth);
  }
  make_blocks(4e-3F, &rays);
  std::vector<std::array<uint8_t, kTilePixels>> results;
  for (const TileKernels* kernels : {&baseline_kernels(), &best_kernels()}) {
    TileSum sum{};
    const std::array<RayShift, 2> coverage = {{{1e-4F, 2e-4F}, {-3e-3F, 1e-3F}}};
    kernels->sample(rays, {faces, {1e-4F, 0}, coverage, 0.5F}, {0.002F, -0.5F}, &sum);
    std::array<uint8_t, kTilePixels> pixels;
    kernels->develop(rays, sum, {1.5F, 0.4F, 3.0F, 99, 0, kTileWidth}, &pixels);
    results.push_back(pixels);
  }
  EXPECT_EQ(results[0], results[1]) << "seed " << seed;
  EXPECT_GT(*std::max_element(results[0].begin(), results[0].end()), 50);
}

}  // namespace
}  // namespace cairn
