// SPDX-License-Identifier: Apache-2.0
//
// The camera of visp-images-data's `cube` sequence, estimated twice: from the dotted box, whose shape is
// known up to scale, and by bundle adjustment of the scene around it, whose shape is not. The two share no
// pixels.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <functional>
#include <map>
#include <numeric>
#include <set>

#include "common/io/calibration.h"
#include "common/io/image_file.h"
#include "tests/bench/cube/adjust.h"
#include "tests/bench/cube/dots.h"
#include "tests/bench/cube/tracks.h"

namespace cairn::cube {
namespace {

constexpr int kWidth = 384;
constexpr int kHeight = 288;
constexpr int kFrameBlocks = 8;
constexpr int kCellsX = 4;  ///< blocks of tracks for the jackknife, by where they lie in the image
constexpr int kCellsY = 2;

struct Arguments {
  std::filesystem::path images = "/usr/share/visp-images-data/ViSP-images/cube";
  std::filesystem::path out;
  bool variants = false;
};

struct Estimate {
  CameraFit fit;
  double frames_sigma = 0;   ///< of the focal length, jackknife over blocks of frames [px]
  double objects_sigma = 0;  ///< the same over dots, or over parts of the scene [px]
  [[nodiscard]] double sigma() const { return std::hypot(frames_sigma, objects_sigma); }
};

Result<std::vector<GrayImage>> read_frames(const std::filesystem::path& folder) {
  std::vector<std::filesystem::path> paths;
  std::error_code error;
  for (const auto& entry : std::filesystem::directory_iterator(folder, error)) paths.push_back(entry.path());
  if (error)
    return fail(ErrorCode::kNotFound,
                folder.string() + ": " + error.message() + "; install Debian's visp-images-data");
  std::sort(paths.begin(), paths.end());
  std::vector<GrayImage> frames;
  for (const auto& path : paths) {
    auto frame = read_gray_image(path);
    if (!frame) return tl::unexpected<Error>(frame.error());
    frames.push_back(std::move(*frame));
  }
  return frames;
}

CubeCamera start_camera() {
  CubeCamera camera;
  camera.focal = 600;
  camera.cx = 0.5 * (kWidth - 1);
  camera.cy = 0.5 * (kHeight - 1);
  return camera;
}

/// The model of both estimates. The centre is the image's: neither tells it well (see --variants).
Freedom model() {
  Freedom freedom;
  freedom.aspect = true;
  freedom.k1 = true;
  return freedom;
}

/// Index of the block of frames that a frame belongs to.
int frame_block(const std::vector<int>& views, int frame) {
  const auto at = std::lower_bound(views.begin(), views.end(), frame) - views.begin();
  return static_cast<int>(static_cast<size_t>(at) * kFrameBlocks / views.size());
}

Result<double> jackknife(int groups, const std::function<Result<CameraFit>(int left_out)>& fit) {
  std::vector<double> focals;
  for (int i = 0; i < groups; ++i) {
    const auto without = fit(i);
    if (!without) return tl::unexpected<Error>(without.error());
    focals.push_back(without->camera.focal);
    std::fprintf(stderr, ".");
  }
  return jackknife_sigma(focals);
}

Result<Estimate> from_dots(const std::vector<DotSighting>& dots, const std::vector<int>& views) {
  const auto full = fit_to_dots(dots, start_camera(), model());
  if (!full) return tl::unexpected<Error>(full.error());
  const auto without = [&](const auto& left_out) {
    std::vector<DotSighting> rest = dots;
    std::erase_if(rest, left_out);
    return fit_to_dots(rest, full->camera, model(), full->scale);
  };
  std::vector<Dot> all;
  for (const Face face : {Face::kTop, Face::kFront, Face::kLeft}) {
    const std::vector<Dot> of_face = dots_of(face);
    all.insert(all.end(), of_face.begin(), of_face.end());
  }
  const auto frames = jackknife(kFrameBlocks, [&](int block) {
    return without([&](const DotSighting& s) { return frame_block(views, s.frame) == block; });
  });
  if (!frames) return tl::unexpected<Error>(frames.error());
  const auto objects = jackknife(static_cast<int>(all.size()), [&](int i) {
    return without([&](const DotSighting& s) { return s.dot == all[static_cast<size_t>(i)]; });
  });
  if (!objects) return tl::unexpected<Error>(objects.error());
  return Estimate{*full, *frames, *objects};
}

/// Which of the image's cells a track lies in, in the mean.
int cell(const Track& track) {
  Eigen::Vector2d sum = Eigen::Vector2d::Zero();
  for (const Track::Sighting& s : track.sightings) sum += s.pixel;
  sum /= static_cast<double>(track.sightings.size());
  const int x = std::clamp(static_cast<int>(sum.x() * kCellsX / kWidth), 0, kCellsX - 1);
  const int y = std::clamp(static_cast<int>(sum.y() * kCellsY / kHeight), 0, kCellsY - 1);
  return y * kCellsX + x;
}

/// `start`: poses by frame and a camera, from the dots; where the adjustment begins, nothing more.
Result<Estimate> from_scene(const std::vector<Track>& tracks, const std::vector<int>& views,
                            const CameraFit& start) {
  const auto full = fit_to_tracks(tracks, {start.camera, start.camera_from_object, {}, 0}, model());
  if (!full) return tl::unexpected<Error>(full.error());
  const SceneStart again{full->camera, full->camera_from_object, full->points, full->scale};
  const auto frames = jackknife(kFrameBlocks, [&](int block) {
    std::vector<Track> rest = tracks;
    for (Track& track : rest) {
      std::erase_if(track.sightings,
                    [&](const Track::Sighting& s) { return frame_block(views, s.frame) == block; });
    }
    return fit_to_tracks(rest, again, model());
  });
  if (!frames) return tl::unexpected<Error>(frames.error());
  const auto objects = jackknife(kCellsX * kCellsY, [&](int left_out) {
    std::vector<Track> rest = tracks;
    for (Track& track : rest) {
      if (cell(track) == left_out) track.sightings.clear();
    }
    return fit_to_tracks(rest, again, model());
  });
  if (!objects) return tl::unexpected<Error>(objects.error());
  return Estimate{*full, *frames, *objects};
}

void print_camera(const char* name, const CameraFit& fit) {
  const CubeCamera& c = fit.camera;
  const CubeCamera& s = fit.sigma;
  std::printf(
      "%-22s fx %6.1f (%.1f)  fy/fx %.4f (%.4f)  k1 %6.3f (%.3f)  centre %5.1f %5.1f (%.1f %.1f)  "
      "residual %.3f px\n",
      name, c.focal, s.focal, c.aspect, s.aspect, c.k1, s.k1, c.cx, c.cy, s.cx, s.cy, fit.rms);
}

void print_estimate(const char* name, const char* objects, const Estimate& e) {
  print_camera(name, e.fit);
  std::printf(
      "%-22s sigma of fx: %.1f px from the covariance, %.1f over blocks of frames, %.1f over %s: %.1f px "
      "(%.1f %%)\n",
      "", e.fit.sigma.focal, e.frames_sigma, e.objects_sigma, objects, e.sigma(),
      100 * e.sigma() / e.fit.camera.focal);
}

void print_quantiles(const char* name, std::vector<double> values) {
  if (values.empty()) return;
  std::sort(values.begin(), values.end());
  const auto at = [&](double q) {
    return values[static_cast<size_t>(q * static_cast<double>(values.size() - 1))];
  };
  std::printf("  %-24s n %6zu  p50 %.3f  p90 %.3f  p99 %.3f px\n", name, values.size(), at(0.5), at(0.9),
              at(0.99));
}

void print_residuals(const std::vector<DotSighting>& dots, const CameraFit& dot_fit,
                     const std::vector<Track>& tracks, const CameraFit& scene_fit) {
  std::printf("residuals, lengths:\n");
  std::map<Face, std::vector<double>> by_face;
  for (size_t i = 0; i < dots.size(); ++i) by_face[dots[i].dot.face].push_back(dot_fit.residuals[i]);
  print_quantiles("dots, top", by_face[Face::kTop]);
  print_quantiles("dots, front", by_face[Face::kFront]);
  print_quantiles("dots, left", by_face[Face::kLeft]);
  constexpr double kRing = 80;  // px
  std::map<int, std::vector<double>> by_ring;
  size_t i = 0;
  for (const Track& track : tracks) {
    for (const Track::Sighting& s : track.sightings) {
      const double r = (s.pixel - Eigen::Vector2d(scene_fit.camera.cx, scene_fit.camera.cy)).norm();
      by_ring[static_cast<int>(r / kRing)].push_back(scene_fit.residuals[i++]);
    }
  }
  for (const auto& [ring, values] : by_ring) {
    const std::string name = "scene, " + std::to_string(static_cast<int>(kRing) * ring) + "-" +
                             std::to_string(static_cast<int>(kRing) * (ring + 1)) + " px off centre";
    print_quantiles(name.c_str(), values);
  }
}

void print_variants(const std::vector<DotSighting>& dots, const std::vector<Track>& tracks,
                    const CameraFit& start) {
  struct Variant {
    const char* name;
    bool aspect, centre, k1;
  };
  std::printf("other models (sigma from the covariance):\n");
  for (const Variant& v : {Variant{"square pixels", false, false, false},
                           {"no distortion", true, false, false},
                           {"free centre", true, true, true}}) {
    Freedom freedom;
    freedom.aspect = v.aspect;
    freedom.centre = v.centre;
    freedom.k1 = v.k1;
    const auto dot_fit = fit_to_dots(dots, start_camera(), freedom);
    if (dot_fit) print_camera((std::string("  dots, ") + v.name).c_str(), *dot_fit);
    CubeCamera from = start_camera();
    from.aspect = v.aspect ? start.camera.aspect : 1;
    const auto scene_fit = fit_to_tracks(tracks, {from, start.camera_from_object, {}, 0}, freedom);
    if (scene_fit) print_camera((std::string("  scene, ") + v.name).c_str(), *scene_fit);
  }
  Freedom top = model();
  top.side_faces = false;
  if (const auto fit = fit_to_dots(dots, start_camera(), top)) print_camera("  dots, top face only", *fit);
  Freedom lean = model();
  lean.right_angles = false;
  if (const auto fit = fit_to_dots(dots, start_camera(), lean)) {
    print_camera("  dots, free angles", *fit);
    std::printf("%-22s front leans by %.2f, left by %.2f degrees\n", "", fit->box[kFrontLean] * 180 / M_PI,
                fit->box[kLeftLean] * 180 / M_PI);
  }
}

/// Mean of the two, weighted by 1 / sigma^2 of the focal length, all parameters alike.
CubeCamera weighted_mean(const Estimate& a, const Estimate& b) {
  const double wa = 1 / (a.sigma() * a.sigma());
  const double wb = 1 / (b.sigma() * b.sigma());
  const auto mean = [&](double x, double y) { return (wa * x + wb * y) / (wa + wb); };
  const CubeCamera& p = a.fit.camera;
  const CubeCamera& q = b.fit.camera;
  return {mean(p.focal, q.focal), mean(p.aspect, q.aspect), mean(p.cx, q.cx), mean(p.cy, q.cy),
          mean(p.k1, q.k1)};
}

Status write(const std::filesystem::path& path, const CubeCamera& camera, double sigma, const Estimate& dots,
             const Estimate& scene) {
  const auto round_to = [](double v, double parts) { return std::round(v * parts) / parts; };
  CameraParameters parameters;
  parameters.width = kWidth;
  parameters.height = kHeight;
  parameters.values = {round_to(camera.focal, 10),
                       round_to(camera.focal * camera.aspect, 10),
                       round_to(camera.cx, 10),
                       round_to(camera.cy, 10),
                       round_to(camera.k1, 1000),
                       0,
                       0,
                       0,
                       0};
  char text[800];
  std::snprintf(
      text, sizeof text,
      "Camera of the `cube` sequence of Debian's visp-images-data: width height fx fy cx cy k1 k2 p1 p2 "
      "(OpenCV).\nMade by tests/bench's cairn-cube-calibration: fx %.1f px, sigma %.1f, the weighted mean "
      "of %.1f, sigma %.1f, from the\ndotted box (square grids at right angles) and %.1f, sigma %.1f, from "
      "bundle adjustment of the scene without the dots; they differ by\n%.1f %%. Centre: the image's. "
      "The pixels are not square: both say so.",
      camera.focal, sigma, dots.fit.camera.focal, dots.sigma(), scene.fit.camera.focal, scene.sigma(),
      100 * std::abs(dots.fit.camera.focal - scene.fit.camera.focal) / camera.focal);
  return write_calibration_txt(path, parameters, text);
}

Status run(const Arguments& arguments) {
  const auto frames = read_frames(arguments.images);
  if (!frames) return tl::unexpected<Error>(frames.error());
  auto dots = follow_dots(*frames);
  if (!dots) return tl::unexpected<Error>(dots.error());
  const std::vector<int> views = moving_frames(*dots);
  const std::set<int> moving(views.begin(), views.end());
  std::erase_if(*dots, [&](const DotSighting& s) { return !moving.contains(s.frame); });
  const std::vector<Track> tracks = follow_patches(*frames, views, *dots);
  const size_t sightings =
      std::accumulate(tracks.begin(), tracks.end(), size_t{0},
                      [](size_t sum, const Track& track) { return sum + track.sightings.size(); });
  std::printf(
      "views %zu (frames %d to %d, camera moving); dots seen %zu; scene: %zu patches seen %zu times\n",
      views.size(), views.front(), views.back(), dots->size(), tracks.size(), sightings);

  const auto by_dots = from_dots(*dots, views);
  if (!by_dots) return tl::unexpected<Error>(by_dots.error());
  const auto by_scene = from_scene(tracks, views, by_dots->fit);
  if (!by_scene) return tl::unexpected<Error>(by_scene.error());
  std::fprintf(stderr, "\n");
  print_estimate("dotted box", "dots", *by_dots);
  print_estimate("adjustment of scene", "parts of the scene", *by_scene);
  const CubeCamera mean = weighted_mean(*by_dots, *by_scene);
  const double difference = std::abs(by_dots->fit.camera.focal - by_scene->fit.camera.focal);
  const double combined = 1 / std::hypot(1 / by_dots->sigma(), 1 / by_scene->sigma());
  // Birge: two values further apart than their sigmas allow are each less sure than they say.
  const double sigma = combined * std::max(1.0, difference / std::hypot(by_dots->sigma(), by_scene->sigma()));
  std::printf(
      "difference %.1f px (%.1f %%); weighted mean fx %.1f, sigma %.1f px (%.1f %%), fy %.1f, k1 %.3f\n",
      difference, 100 * difference / mean.focal, mean.focal, sigma, 100 * sigma / mean.focal,
      mean.focal * mean.aspect, mean.k1);
  print_residuals(*dots, by_dots->fit, tracks, by_scene->fit);
  if (arguments.variants) print_variants(*dots, tracks, by_dots->fit);
  if (!arguments.out.empty()) {
    if (auto written = write(arguments.out, mean, sigma, *by_dots, *by_scene); !written) return written;
    std::printf("written: %s\n", arguments.out.c_str());
  }
  if (difference > 0.05 * mean.focal) return fail(ErrorCode::kDegenerate, "the two differ by more than 5 %");
  return {};
}

}  // namespace
}  // namespace cairn::cube

int main(int argc, char** argv) {
  CLI::App app{"Calibrates the camera of visp-images-data's cube sequence in two independent ways"};
  cairn::cube::Arguments arguments;
  app.add_option("--images", arguments.images, "folder of the 80 frames")->capture_default_str();
  app.add_option("--out", arguments.out, "camera file to write");
  app.add_flag("--variants", arguments.variants, "other camera models too (takes a while)");
  CLI11_PARSE(app, argc, argv);
  const cairn::Status status = cairn::cube::run(arguments);
  if (!status) {
    std::fprintf(stderr, "%s\n", status.error().message.c_str());
    return cairn::exit_code(status.error().code);
  }
  return 0;
}
