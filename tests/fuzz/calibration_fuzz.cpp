// SPDX-License-Identifier: Apache-2.0
#include "common/io/calibration.h"
#include "tests/fuzz/fuzz_target.h"

namespace cairn::fuzz {
namespace {

/// The same camera in the formats that are read (common/io/calibration.h).
constexpr const char* kFiles[] = {
    "640 480 525.5 525.5 319.5 239.5 0.1 -0.2 0.001 -0.001 0.05\n",
    "0.8 1.07 0.5 0.5 0.92\n640 480\ncrop\n640 480\n",
    "Camera.Parameters=[ 0.8 1.07 0.5 0.5 0.92 ]\n",
    "cam0:\n  camera_model: pinhole\n  distortion_model: equidistant\n  intrinsics: [525, 525, 320, 240]\n"
    "  distortion_coeffs: [0.1, 0.01, 0, 0]\n  resolution: [640, 480]\n  T_cam_imu: "
    "[[1,0,0,0],[0,1,0,0],[0,0,1,0],"
    "[0,0,0,1]]\n",
    "%YAML:1.0\n---\nimage_width: 640\nimage_height: 480\ncamera_matrix: !!opencv-matrix\n   rows: 3\n   "
    "cols: 3\n"
    "   dt: d\n   data: [ 525., 0., 320., 0., 525., 240., 0., 0., 1. ]\ndistortion_coefficients: "
    "!!opencv-matrix\n"
    "   rows: 5\n   cols: 1\n   dt: d\n   data: [ 0.1, 0., 0., 0., 0. ]\n",
    "<?xml version=\"1.0\"?>\n<opencv_storage>\n<image_width>640</image_width>\n"
    "<image_height>480</image_height>\n<camera_matrix "
    "type_id=\"opencv-matrix\">\n<rows>3</rows><cols>3</cols>"
    "<dt>d</dt>\n<data>525. 0. 320. 0. 525. 240. 0. 0. 1.</data></camera_matrix>\n"
    "<distortion_coefficients type_id=\"opencv-matrix\">\n<rows>5</rows><cols>1</cols><dt>d</dt>\n"
    "<data>0.1 0. 0. 0. 0.</data></distortion_coefficients>\n</opencv_storage>\n",
    "height: 480\nwidth: 640\ndistortion_model: plumb_bob\nd: [0.1, 0, 0, 0, 0]\n"
    "k: [525, 0, 320, 0, 525, 240, 0, 0, 1]\n",
    "%YAML:1.0\nCamera.type: \"PinHole\"\nCamera.fx: 525\nCamera.fy: 525\nCamera.cx: 320\nCamera.cy: 240\n"
    "Camera.k1: 0.1\nCamera.k2: 0\nCamera.p1: 0\nCamera.p2: 0\nCamera.width: 640\nCamera.height: 480\n",
    "# Camera list\n1 OPENCV 640 480 525 525 320 240 0.1 0 0 0\n",
    "P0: 718.8 0 607.1 0 0 718.8 185.2 0 0 0 1 0\n",
    "S_02: 640 480\nK_02: 525 0 320 0 525 240 0 0 1\nD_02: -0.36 0.2 0.001 0 -0.06\n",
};

}  // namespace

void decode(Bytes bytes) {
  const MemoryFile file(bytes);
  const auto camera = read_calibration(file.path(), ImageSize{640, 480});
  if (!camera) return;
  demand(make_camera(*camera).has_value(), "a calibration that is read makes a camera");
  demand(!describe_camera(*camera).empty(), "a camera can be described");
}

std::vector<Input> seeds() {
  std::vector<Input> files;
  for (const char* file : kFiles) {
    const MemoryFile in_memory(bytes_of(file));
    const auto camera = read_calibration(in_memory.path(), ImageSize{640, 480});
    demand(camera.has_value(), camera ? file : camera.error().message.c_str());
    files.push_back(copy_of(file));
  }
  return files;
}

}  // namespace cairn::fuzz
