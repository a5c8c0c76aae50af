// Options as messages and as the JSON documents that core reads. Fields have the same names in both, so protobuf's own
// mapping does; what a field means, and which values are allowed, core alone knows (core/options, core/session).
#ifndef DEPTHTWEEN_PROTO_DEPTHTWEEN_DOCUMENTS_H_
#define DEPTHTWEEN_PROTO_DEPTHTWEEN_DOCUMENTS_H_

#include <google/protobuf/message.h>
#include <google/protobuf/util/json_util.h>

#include <string>

namespace depthtween {

// Fields that are not set, or have the value 0 without presence, are left out.
inline std::string DocumentOf(const google::protobuf::Message& message) {
  google::protobuf::util::JsonPrintOptions options;
  options.preserve_proto_field_names = true;
  std::string document;
  // Fails for Any and Timestamp values out of range alone, which options do not have.
  if (!google::protobuf::util::MessageToJsonString(message, &document, options).ok()) return "{}";
  return document;
}

// Fields that `message` does not have are left out. False if `document` is not JSON of such a message.
inline bool ReadDocument(const std::string& document, google::protobuf::Message* message) {
  google::protobuf::util::JsonParseOptions options;
  options.ignore_unknown_fields = true;
  return google::protobuf::util::JsonStringToMessage(document, message, options).ok();
}

}  // namespace depthtween

#endif  // DEPTHTWEEN_PROTO_DEPTHTWEEN_DOCUMENTS_H_
