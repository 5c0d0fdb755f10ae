// SPDX-License-Identifier: Apache-2.0
#include "client/app/images/image_demand.h"

#include <algorithm>

#include "client/app/images/image_choice.h"

namespace cairn {
namespace {

using std::chrono::milliseconds;

constexpr milliseconds kSilence = 3 * kPictureRequestPeriod + milliseconds(100);  // some may be lost
constexpr milliseconds kStep{100};
constexpr milliseconds kLate{50};  // is caught up with: frames do not come at tenths of a second
constexpr size_t kMostAskers = 16;

}  // namespace

void ImageDemand::hear(const wire::PictureRequest& request, MonotonicTime now) {
  if (request.camera != camera_) {
    asked_.erase(request.name);
    return;
  }
  std::erase_if(asked_, [now](const auto& asker) { return now - asker.second > kSilence; });
  if (asked_.size() < kMostAskers || asked_.contains(request.name)) asked_[request.name] = now;
}

bool ImageDemand::is_asked(MonotonicTime now) const {
  return std::any_of(asked_.begin(), asked_.end(),
                     [now](const auto& asker) { return now - asker.second <= kSilence; });
}

std::vector<std::string> ImageDemand::askers(MonotonicTime now) const {
  std::vector<std::string> names;
  for (const auto& [name, when] : asked_) {
    if (now - when <= kSilence) names.push_back(name);
  }
  return names;
}

bool ImageDemand::take_turn(MonotonicTime now) {
  if (now < due_ || !is_asked(now)) return false;
  due_ = std::max(due_, now - kLate) + kStep;
  return true;
}

}  // namespace cairn
