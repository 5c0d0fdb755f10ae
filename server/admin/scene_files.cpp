// SPDX-License-Identifier: Apache-2.0
#include "server/admin/scene_files.h"

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <fstream>
#include <iomanip>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <sstream>
#include <string_view>

#include "server/store/bytes.h"
#include "server/store/row_codec.h"

namespace cairn {
namespace {

namespace fs = std::filesystem;

constexpr double kPixelShift = 0.5;  ///< COLMAP: (0,0) is the corner of the first pixel

/// A camera in COLMAP's terms.
struct ColmapCamera {
  int32_t model = 0;
  std::string_view name;
  std::vector<double> parameters;
};

/// Whether all behind fx fy cx cy is 0. A fisheye's projection is none of a pinhole even then.
bool is_pinhole(const CameraParameters& camera) {
  return camera.model != CameraModel::kKannalaBrandt &&
         std::all_of(camera.values.begin() + 4, camera.values.end(), [](double value) { return value == 0; });
}

/// The simplest model that has it exactly: many programs read PINHOLE only.
ColmapCamera to_colmap(const CameraParameters& camera) {
  std::vector<double> values = camera.values;
  values[2] += kPixelShift;
  values[3] += kPixelShift;
  if (is_pinhole(camera)) {
    values.resize(4);
    return {1, "PINHOLE", std::move(values)};
  }
  switch (camera.model) {
    case CameraModel::kKannalaBrandt:
      values.resize(8);
      return {5, "OPENCV_FISHEYE", std::move(values)};
    case CameraModel::kFov:
      values.resize(5);
      return {7, "FOV", std::move(values)};
    case CameraModel::kPinholeRadtan:
      break;
  }
  values.resize(9);
  if (values[8] == 0) {
    values.pop_back();
    return {4, "OPENCV", std::move(values)};
  }
  values.resize(12);  // k4 k5 k6 of the rational model
  return {6, "FULL_OPENCV", std::move(values)};
}

Status make_folder(const fs::path& folder) {
  std::error_code problem;
  fs::create_directories(folder, problem);
  if (problem) return fail(ErrorCode::kIo, folder.string() + ": cannot be made: " + problem.message());
  return {};
}

Status write_file(const fs::path& path, std::string_view content) {
  if (Status made = make_folder(path.parent_path()); !made) return made;
  errno = 0;  // a stream keeps it, and says nothing else
  std::ofstream out(path, std::ios::binary);
  out.write(content.data(), static_cast<std::streamsize>(content.size()));
  out.close();
  if (out) return {};
  return fail(ErrorCode::kIo, path.string() + ": cannot be written: " + std::strerror(errno));
}

Status write_file(const fs::path& path, const Blob& content) {
  return write_file(path, {reinterpret_cast<const char*>(content.data()), content.size()});
}

/// PNG of three equal channels.
Blob encode_rgb(const GrayImage& image) {
  const cv::Mat grey(image.height(), image.width(), CV_8UC1, const_cast<uint8_t*>(image.row(0)),
                     static_cast<size_t>(image.stride()));
  cv::Mat rgb;
  cv::merge(std::vector<cv::Mat>(3, grey), rgb);
  Blob bytes;
  cv::imencode(".png", rgb, bytes);
  return bytes;
}

std::ostringstream exact_text() {
  std::ostringstream out;
  out << std::setprecision(17);
  return out;
}

std::string cameras_text(const ExportedScene& scene) {
  std::ostringstream out = exact_text();
  out << "# CAMERA_ID MODEL WIDTH HEIGHT PARAMS[]\n";
  for (const auto& [number, camera] : scene.cameras) {
    const ColmapCamera colmap = to_colmap(camera);
    out << number << ' ' << colmap.name << ' ' << camera.width << ' ' << camera.height;
    for (const double value : colmap.parameters) out << ' ' << value;
    out << '\n';
  }
  return out.str();
}

std::string images_text(const ExportedScene& scene) {
  std::ostringstream out = exact_text();
  out << "# IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME\n# POINTS2D[] as X Y POINT3D_ID\n";
  for (const ExportedImage& p : scene.images) {
    const Eigen::Quaterniond& q = p.camera_from_map.rotation();
    const Eigen::Vector3d& t = p.camera_from_map.translation();
    out << p.id << ' ' << q.w() << ' ' << q.x() << ' ' << q.y() << ' ' << q.z() << ' ' << t.x() << ' '
        << t.y() << ' ' << t.z() << ' ' << p.camera << ' ' << p.file << '\n';
    const char* separator = "";
    for (const auto& [id, pixel] : p.found) {
      out << separator << pixel.x() + kPixelShift << ' ' << pixel.y() + kPixelShift << ' ' << id.value;
      separator = " ";
    }
    out << '\n';
  }
  return out.str();
}

std::string points_text(const ExportedScene& scene) {
  std::ostringstream out = exact_text();
  out << "# POINT3D_ID X Y Z R G B ERROR TRACK[] as IMAGE_ID POINT2D_IDX\n";
  for (const ExportedPoint& p : scene.points) {
    const int grey = p.grey;
    out << p.id.value << ' ' << p.position.x() << ' ' << p.position.y() << ' ' << p.position.z() << ' '
        << grey << ' ' << grey << ' ' << grey << ' ' << p.error;
    for (const auto& [image, place] : p.track) out << ' ' << image << ' ' << place;
    out << '\n';
  }
  return out.str();
}

Blob cameras_binary(const ExportedScene& scene) {
  ByteWriter out;
  out.put(uint64_t{scene.cameras.size()});
  for (const auto& [number, camera] : scene.cameras) {
    const ColmapCamera colmap = to_colmap(camera);
    out.put(number);
    out.put(colmap.model);
    out.put(static_cast<uint64_t>(camera.width));
    out.put(static_cast<uint64_t>(camera.height));
    for (const double value : colmap.parameters) out.put(value);
  }
  return out.take();
}

Blob images_binary(const ExportedScene& scene) {
  ByteWriter out;
  out.put(uint64_t{scene.images.size()});
  for (const ExportedImage& p : scene.images) {
    const Eigen::Quaterniond& q = p.camera_from_map.rotation();
    out.put(p.id);
    out.put(Eigen::Vector4d(q.w(), q.x(), q.y(), q.z()));
    out.put(p.camera_from_map.translation());
    out.put(p.camera);
    for (const char c : p.file) out.put(static_cast<uint8_t>(c));
    out.put(uint8_t{0});
    out.put(uint64_t{p.found.size()});
    for (const auto& [id, pixel] : p.found) {
      out.put(pixel.x() + kPixelShift);
      out.put(pixel.y() + kPixelShift);
      out.put(id.value);
    }
  }
  return out.take();
}

Blob points_binary(const ExportedScene& scene) {
  ByteWriter out;
  out.put(uint64_t{scene.points.size()});
  for (const ExportedPoint& p : scene.points) {
    out.put(p.id.value);
    out.put(p.position);
    for (int channel = 0; channel < 3; ++channel) out.put(p.grey);
    out.put(p.error);
    out.put(uint64_t{p.track.size()});
    for (const auto& [image, place] : p.track) {
      out.put(image);
      out.put(place);
    }
  }
  return out.take();
}

}  // namespace

Status write_colmap_text(const ExportedScene& scene, const fs::path& folder) {
  Status done = write_file(folder / "cameras.txt", cameras_text(scene));
  if (done) done = write_file(folder / "images.txt", images_text(scene));
  if (done) done = write_file(folder / "points3D.txt", points_text(scene));
  return done;
}

Status write_colmap_binary(const ExportedScene& scene, const fs::path& folder) {
  Status done = write_file(folder / "cameras.bin", cameras_binary(scene));
  if (done) done = write_file(folder / "images.bin", images_binary(scene));
  if (done) done = write_file(folder / "points3D.bin", points_binary(scene));
  return done;
}

Status write_images(const ExportedScene& scene, const fs::path& folder) {
  if (Status made = make_folder(folder); !made) return made;
  for (const ExportedImage& p : scene.images) {
    if (p.image == nullptr) continue;
    const Blob png = scene.rgb ? encode_rgb(*p.image) : encode_image_row(*p.image);
    if (Status done = write_file(folder / p.file, png); !done) return done;
  }
  return {};
}

Status write_ply(const ExportedScene& scene, const fs::path& file) {
  std::ostringstream header;
  header << "ply\nformat binary_little_endian 1.0\n"
         << kPlyComment << "\nelement vertex " << scene.points.size() << '\n';
  for (const char* name : {"x", "y", "z", "nx", "ny", "nz"}) header << "property float " << name << '\n';
  for (const char* name : {"red", "green", "blue"}) header << "property uchar " << name << '\n';
  header << "end_header\n";
  ByteWriter vertices;
  for (const ExportedPoint& p : scene.points) {
    vertices.put(Eigen::Vector3f(p.position.cast<float>()));
    vertices.put(Eigen::Vector3f(p.normal.cast<float>()));
    for (int channel = 0; channel < 3; ++channel) vertices.put(p.grey);
  }
  const Blob body = vertices.take();
  return write_file(file, header.str().append(reinterpret_cast<const char*>(body.data()), body.size()));
}

}  // namespace cairn
