// SPDX-License-Identifier: Apache-2.0
//
// What people write for cairn-track: where the tags of a board are, and labels that are placed at a time.
// The first byte says which.
#include "client/app/calibrate/tag_file.h"
#include "client/app/viewer/label_file.h"
#include "common/base/utf8.h"
#include "common/map/label.h"
#include "tests/fuzz/fuzz_target.h"

namespace cairn::fuzz {
namespace {

void read_tags(const MemoryFile& file) {
  const auto plan = read_tag_plan(file.path());
  if (!plan) return demand(!plan.error().message.empty(), "a refusal has a reason");
  demand(!plan->tags.empty(), "a board has a tag");
  for (const auto& [id, corners] : plan->tags) {
    for (const Eigen::Vector3d& corner : corners) demand(corner.allFinite(), "a corner is finite");
  }
}

void read_labels(const MemoryFile& file) {
  const auto labels = read_timed_labels(file.path(), {640, 480});
  if (!labels) return demand(!labels.error().message.empty(), "a refusal has a reason");
  for (const TimedLabel& label : *labels) {
    demand(!fault_of_text(label.text) && label.text.size() <= kMaxLabelBytes, "a label's text can be kept");
    demand(cv::Rect(0, 0, 640, 480).contains(label.pixel), "a label is in the image");
  }
}

}  // namespace

void decode(Bytes bytes) {
  if (bytes.empty()) return;
  const MemoryFile file(bytes.subspan(1));
  bytes[0] % 2 == 0 ? read_tags(file) : read_labels(file);
}

std::vector<Input> seeds() {
  return {input_of(0, "{\"0\": [[0, 0, 0], [0.1, 0, 0], [0.1, 0.1, 0], [0, 0.1, 0]], \"note\": \"mm\"}"),
          input_of(0, "target_type: 'aprilgrid'\ntagCols: 6\ntagRows: 6\ntagSize: 0.088\ntagSpacing: 0.3\n"),
          input_of(1,
                   "# labels\ntimestamp x y text\n1.5 320 240 the kettle\n2.25 0 479 K\xc3\xbc"
                   "che\n")};
}

}  // namespace cairn::fuzz
