// SPDX-License-Identifier: Apache-2.0
#include "client/capture/frame_source.h"

#include <fmt/format.h>

#include <array>

#include "client/capture/image_list_source.h"
#ifdef CAIRN_SIMULATOR
#include "client/capture/simulated_source.h"
#endif
#include "client/capture/source_uri.h"
#include "client/capture/v4l2_source.h"
#include "client/capture/video_source.h"

namespace cairn {
namespace {

using Opener = Result<std::unique_ptr<FrameSource>> (*)(const SourceUri&);

struct Scheme {
  std::string_view name;
  Opener open;
};

constexpr std::array kSchemes = {
    Scheme{"tum", open_tum_source},       Scheme{"euroc", open_euroc_source},
    Scheme{"images", open_images_source}, Scheme{"video", open_video_source},
    Scheme{"v4l2", open_v4l2_source},
#ifdef CAIRN_SIMULATOR
    Scheme{"sim", open_simulated_source},
#endif
};

}  // namespace

Result<std::unique_ptr<FrameSource>> open_source(std::string_view text) {
  const auto uri = parse_source_uri(text);
  if (!uri) return tl::unexpected(uri.error());
  std::string names;
  for (const auto& scheme : kSchemes) {
    if (scheme.name == uri->scheme) return scheme.open(*uri);
    names += (names.empty() ? "" : ", ") + std::string(scheme.name) + ":";
  }
  return fail(ErrorCode::kUsage,
              "source '" + std::string(text) + "': no scheme '" + uri->scheme + ":'; there are " + names);
}

std::vector<std::filesystem::path> source_files(std::string_view text) {
  const auto uri = parse_source_uri(text);
  if (!uri) return {};
  std::vector<std::filesystem::path> files;
  const std::filesystem::path path(uri->path);
  if (uri->scheme == "tum") files.push_back(path / "rgb.txt");
  if (uri->scheme == "euroc") files.push_back(euroc_camera_folder(*uri) / "data.csv");
  if (uri->scheme == "video") files.push_back(path);
  if (const auto times = uri->options.find("times"); times != uri->options.end())
    files.emplace_back(times->second);
  return files;
}

Status check_image_size(const FrameSource& source, const CameraParameters& calibration) {
  const auto size = source.image_size();
  const ImageSize calibrated{calibration.width, calibration.height};
  if (!size || *size == calibrated) return {};
  const bool is_exchanged = size->width == calibrated.height && size->height == calibrated.width;
  return fail(
      ErrorCode::kConfiguration,
      fmt::format("{}: its images are {}x{}, the calibration is for {}x{}{}; pass the camera's own with "
                  "--calibration{}",
                  source.describe(), size->width, size->height, calibrated.width, calibrated.height,
                  is_exchanged ? ", width and height exchanged" : "",
                  is_exchanged ? ", of upright images: `cairn-track calibrate` turns images as tracking "
                                 "does"
                               : ""));
}

std::optional<std::filesystem::path> find_calibration(std::string_view text) {
  const auto uri = parse_source_uri(text);
  if (!uri) return std::nullopt;
  std::vector<std::filesystem::path> candidates;
  const std::filesystem::path path(uri->path);
  if (uri->scheme == "tum") candidates = {path / "camera.txt"};
  if (uri->scheme == "euroc") candidates = {euroc_camera_folder(*uri) / "sensor.yaml", path / "camera.txt"};
  if (uri->scheme == "images") candidates = {path / "camera.txt", path / ".." / "camera.txt"};
  if (uri->scheme == "video") candidates = {path.parent_path() / "camera.txt"};
  for (const auto& candidate : candidates) {
    std::error_code ignored;
    if (std::filesystem::is_regular_file(candidate, ignored)) return candidate.lexically_normal();
  }
  return std::nullopt;
}

}  // namespace cairn
