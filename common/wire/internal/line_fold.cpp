// SPDX-License-Identifier: Apache-2.0
#include "common/wire/internal/line_fold.h"

namespace cairn::wire::internal {

std::vector<LineFold::Said> LineFold::take(std::string_view file, uint32_t line, Said said, TimePoint now) {
  std::vector<Said> out;
  for (auto& [where, place] : places_) {
    if (now - place.begun >= kInterval) tell_folded(&place, &out);
  }
  Place& place = places_[{std::string(file), line}];
  if (place.interval.due(now)) {
    place.begun = now;
    place.said.clear();
  }
  const bool is_new = place.said.size() < kLinesOfAPlace && !place.said.contains(said.text);
  if (is_new && has_room(now)) {
    place.said.insert(said.text);
    out.push_back(std::move(said));
  } else {
    ++place.folded;
    place.last = std::move(said);
  }
  return out;
}

std::vector<LineFold::Said> LineFold::rest() {
  std::vector<Said> out;
  for (auto& [where, place] : places_) tell_folded(&place, &out);
  return out;
}

void LineFold::tell_folded(Place* place, std::vector<Said>* out) const {
  if (place->folded == 0) return;
  out->push_back({"… and " + std::to_string(std::exchange(place->folded, 0)) +
                      " more like it, the last: " + place->last.text,
                  place->last.is_error});
}

bool LineFold::has_room(TimePoint now) {
  if (now - second_ >= std::chrono::seconds(1)) {
    second_ = now;
    lines_ = 0;
  }
  return lines_++ < lines_per_second_;
}

}  // namespace cairn::wire::internal
