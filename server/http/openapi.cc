#include "server/http/openapi.h"

#include <google/protobuf/descriptor.pb.h>

#include <algorithm>
#include <deque>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <set>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_split.h"
#include "absl/strings/strip.h"
#include "depthtween/v1/access.pb.h"
#include "google/api/field_behavior.pb.h"
#include "server/http/api.h"
#include "server/http/api_descriptors.h"
#include "server/http/openapi_files.h"

namespace depthtween::server {
namespace {

using google::protobuf::Descriptor;
using google::protobuf::EnumDescriptor;
using google::protobuf::FieldDescriptor;
using google::protobuf::FileDescriptor;
using google::protobuf::MethodDescriptor;
using OrderedJson = nlohmann::ordered_json;

constexpr char kErrorSchema[] = "google.rpc.Status";

// What is written above something, and behind it.
template <typename Anything>
std::string CommentOf(const Anything& descriptor) {
  google::protobuf::SourceLocation location;
  if (!descriptor.GetSourceLocation(&location)) return "";
  std::vector<std::string> lines;
  for (const absl::string_view line : absl::StrSplit(location.leading_comments + location.trailing_comments, '\n')) {
    lines.emplace_back(absl::StripPrefix(line, " "));
  }
  std::string text = absl::StrJoin(lines, "\n");
  absl::StripAsciiWhitespace(&text);
  return text;
}

template <typename Anything>
void Describe(const Anything& descriptor, OrderedJson& json) {
  if (std::string comment = CommentOf(descriptor); !comment.empty()) json["description"] = std::move(comment);
}

// "depthtween.v1.Job.State" -> "Job.State"; names of others stay whole.
std::string SchemaName(const std::string& full_name) {
  return std::string(absl::StripPrefix(full_name, "depthtween.v1."));
}

bool HasBehavior(const FieldDescriptor& field, google::api::FieldBehavior wanted) {
  const auto& options = field.options();
  for (int i = 0; i < options.ExtensionSize(google::api::field_behavior); ++i) {
    if (options.GetExtension(google::api::field_behavior, i) == wanted) return true;
  }
  return false;
}

class OpenApiWriter {
 public:
  explicit OpenApiWriter(std::string_view version) {
    document_ = {
        {"openapi", "3.1.0"},
        {"info",
         {{"title", "Depthtween"},
          {"version", std::string(version)},
          {"description",
           "Depth video at the frame rate of colour video. The same methods as the gRPC package depthtween.v1."}}},
        {"security", SecurityOf({})},
        {"paths", OrderedJson::object()}};
  }

  void AddMethod(const ApiMethod& method) {
    const PathTemplate path = *PathTemplate::Parse(method.path);
    const MethodDescriptor& descriptor = *method.descriptor;
    // Each further binding of a method needs a name of its own.
    std::string id = absl::StrCat(descriptor.service()->name(), "_", descriptor.name());
    if (const int binding = ++bindings_[id]; binding > 1) absl::StrAppend(&id, "_", binding);
    OrderedJson operation = {{"operationId", id}, {"tags", OrderedJson::array({descriptor.service()->name()})}};
    Describe(descriptor, operation);
    operation["security"] =
        SecurityOf({descriptor.options().GetExtension(v1::scope)}, descriptor.options().GetExtension(v1::signed_link));
    OrderedJson parameters = OrderedJson::array();
    for (const std::string& name : path.StarNames()) {
      parameters.push_back({{"name", name}, {"in", "path"}, {"required", true}, {"schema", {{"type", "string"}}}});
    }
    AddQueryParameters(method, path.variables(), parameters);
    if (descriptor.server_streaming() && descriptor.input_type()->FindFieldByName("resume_token") != nullptr) {
      parameters.push_back(
          {{"name", "Last-Event-ID"},
           {"in", "header"},
           {"description", "The id of the last event seen; what a browser sends when it connects again."},
           {"schema", {{"type", "string"}}}});
    }
    if (!parameters.empty()) operation["parameters"] = std::move(parameters);
    AddBody(method, operation);

    const OrderedJson answer = {{"schema", Reference(*descriptor.output_type())}};
    OrderedJson content;
    if (descriptor.client_streaming()) {
      operation["deprecated"] = true;  // it is there only to say what to use instead
      operation["responses"]["405"] = {{"description", "Upload by the tus protocol, or over gRPC."}};
    } else {
      content = descriptor.server_streaming()
                    ? OrderedJson{{"application/x-ndjson", answer}, {"text/event-stream", answer}}
                    : OrderedJson{{"application/json", answer}};
      operation["responses"]["200"] = {
          {"description", descriptor.server_streaming() ? "Messages, one after another" : "OK"}, {"content", content}};
    }
    operation["responses"]["default"] = {
        {"description", "What went wrong"},
        {"content", {{"application/json", {{"schema", ReferenceByName(kErrorSchema)}}}}}};
    std::string verb = method.http_method;
    absl::AsciiStrToLower(&verb);
    document_["paths"][path.Readable()][verb] = std::move(operation);
  }

  // A route of the server itself.
  // `open`: asks for no token.
  void AddPlain(const std::string& path, const std::string& description, bool open = true) {
    OrderedJson& operation = document_["paths"][path]["get"];
    operation = {{"operationId", path.substr(1)},
                 {"tags", OrderedJson::array({"Server"})},
                 {"description", description},
                 {"responses", {{"200", {{"description", "OK"}}}}}};
    operation["security"] = open ? OrderedJson::array() : SecurityOf({"admin"});
  }

  // Routes that no descriptor tells of. A path may have operations already.
  void AddFileRoutes() {
    OrderedJson files = FileRoutesOfOpenApi();
    for (auto& [path, operations] : files["paths"].items()) {
      for (auto& [verb, operation] : operations.items()) document_["paths"][path][verb] = std::move(operation);
    }
    document_["components"] = std::move(files["components"]);
  }

  std::string Finish(const FileDescriptor& any_file) {
    if (const Descriptor* error = any_file.pool()->FindMessageTypeByName(kErrorSchema)) Need(*error);
    OrderedJson schemas = OrderedJson::object();
    while (!messages_to_write_.empty()) {
      const Descriptor* message = messages_to_write_.front();
      messages_to_write_.pop_front();
      schemas_[SchemaName(message->full_name())] = MessageSchema(*message);
    }
    for (auto& [name, schema] : schemas_) schemas[name] = std::move(schema);
    document_["components"]["securitySchemes"] = {
        {"bearer",
         {{"type", "http"},
          {"scheme", "bearer"},
          {"description",
           "A token made by: depthtween-server token new. Operations name the scopes that it must have. Not asked for "
           "where the server has no tokens."}}},
        {"signature",
         {{"type", "apiKey"},
          {"in", "query"},
          {"name", "signature"},
          {"description", "Of a signed link, instead of a token: for one output, or one job, and a while."}}}};
    document_["components"]["schemas"] = std::move(schemas);
    return document_.dump(2) + "\n";
  }

 private:
  static OrderedJson ReferenceByName(const std::string& name) { return {{"$ref", "#/components/schemas/" + name}}; }

  void Need(const Descriptor& message) {
    if (needed_.insert(message.full_name()).second) messages_to_write_.push_back(&message);
  }

  OrderedJson Reference(const Descriptor& message) {
    const std::string& name = message.full_name();
    if (name == "google.protobuf.Timestamp") return {{"type", "string"}, {"format", "date-time"}};
    if (name == "google.protobuf.Duration") return {{"type", "string"}, {"pattern", "^-?[0-9]+(\\.[0-9]+)?s$"}};
    if (name == "google.protobuf.Empty") return {{"type", "object"}};
    if (name == "google.protobuf.Any") {
      return {{"type", "object"}, {"properties", {{"@type", {{"type", "string"}}}}}, {"additionalProperties", true}};
    }
    Need(message);
    return ReferenceByName(SchemaName(name));
  }

  OrderedJson EnumReference(const EnumDescriptor& type) {
    const std::string name = SchemaName(type.full_name());
    if (needed_.insert(type.full_name()).second) {
      OrderedJson schema = {{"type", "string"}, {"enum", OrderedJson::array()}};
      std::string description = CommentOf(type);
      for (int i = 0; i < type.value_count(); ++i) {
        schema["enum"].push_back(type.value(i)->name());
        const std::string comment = CommentOf(*type.value(i));
        if (!comment.empty()) {
          absl::StrAppend(&description, description.empty() ? "" : "\n", type.value(i)->name(), ": ", comment);
        }
      }
      if (!description.empty()) schema["description"] = description;
      schemas_[name] = std::move(schema);
    }
    return ReferenceByName(name);
  }

  // One value of the field, as protobuf's JSON has it.
  OrderedJson ValueSchema(const FieldDescriptor& field) {
    switch (field.cpp_type()) {
      case FieldDescriptor::CPPTYPE_INT32:
      case FieldDescriptor::CPPTYPE_UINT32:
        return {{"type", "integer"},
                {"format", field.cpp_type() == FieldDescriptor::CPPTYPE_INT32 ? "int32" : "uint32"}};
      case FieldDescriptor::CPPTYPE_INT64:
      case FieldDescriptor::CPPTYPE_UINT64:
        return {{"type", "string"},
                {"format", field.cpp_type() == FieldDescriptor::CPPTYPE_INT64 ? "int64" : "uint64"}};
      case FieldDescriptor::CPPTYPE_DOUBLE:
        return {{"type", "number"}, {"format", "double"}};
      case FieldDescriptor::CPPTYPE_FLOAT:
        return {{"type", "number"}, {"format", "float"}};
      case FieldDescriptor::CPPTYPE_BOOL:
        return {{"type", "boolean"}};
      case FieldDescriptor::CPPTYPE_ENUM:
        return EnumReference(*field.enum_type());
      case FieldDescriptor::CPPTYPE_STRING:
        if (field.type() == FieldDescriptor::TYPE_BYTES) return {{"type", "string"}, {"contentEncoding", "base64"}};
        return {{"type", "string"}};
      case FieldDescriptor::CPPTYPE_MESSAGE:
        return Reference(*field.message_type());
    }
    return {};
  }

  OrderedJson FieldSchema(const FieldDescriptor& field) {
    OrderedJson schema;
    if (field.is_map()) {
      schema = {{"type", "object"}, {"additionalProperties", ValueSchema(*field.message_type()->map_value())}};
    } else if (field.is_repeated()) {
      schema = {{"type", "array"}, {"items", ValueSchema(field)}};
    } else {
      schema = ValueSchema(field);
    }
    Describe(field, schema);
    if (HasBehavior(field, google::api::OUTPUT_ONLY)) schema["readOnly"] = true;
    if (HasBehavior(field, google::api::INPUT_ONLY)) schema["writeOnly"] = true;
    return schema;
  }

  OrderedJson MessageSchema(const Descriptor& message) {
    OrderedJson schema = {{"type", "object"}};
    Describe(message, schema);
    OrderedJson properties = OrderedJson::object(), required = OrderedJson::array();
    for (int i = 0; i < message.field_count(); ++i) {
      const FieldDescriptor& field = *message.field(i);
      properties[field.json_name()] = FieldSchema(field);
      if (HasBehavior(field, google::api::REQUIRED)) required.push_back(field.json_name());
    }
    schema["properties"] = std::move(properties);
    if (!required.empty()) schema["required"] = std::move(required);
    return schema;
  }

  // Fields that neither the path nor the body holds.
  void AddQueryParameters(const ApiMethod& method, const std::vector<std::string>& in_path, OrderedJson& parameters) {
    if (method.body == "*") return;
    const Descriptor& request = *method.descriptor->input_type();
    for (int i = 0; i < request.field_count(); ++i) {
      const FieldDescriptor& field = *request.field(i);
      const bool elsewhere =
          field.name() == method.body || std::find(in_path.begin(), in_path.end(), field.name()) != in_path.end();
      if (elsewhere || (field.cpp_type() == FieldDescriptor::CPPTYPE_MESSAGE && !IsText(*field.message_type())))
        continue;
      OrderedJson parameter = {{"name", field.json_name()}, {"in", "query"}};
      Describe(field, parameter);
      if (HasBehavior(field, google::api::REQUIRED)) parameter["required"] = true;
      parameter["schema"] =
          field.is_repeated() ? OrderedJson{{"type", "array"}, {"items", ValueSchema(field)}} : ValueSchema(field);
      parameters.push_back(std::move(parameter));
    }
  }

  // Messages whose JSON is a text.
  static bool IsText(const Descriptor& message) {
    return message.full_name() == "google.protobuf.Timestamp" || message.full_name() == "google.protobuf.Duration";
  }

  void AddBody(const ApiMethod& method, OrderedJson& operation) {
    if (method.body.empty()) return;
    const Descriptor& request = *method.descriptor->input_type();
    OrderedJson schema;
    if (method.body == "*") {
      // What the path says need not be said again.
      schema = Reference(request);
    } else {
      schema = ValueSchema(*request.FindFieldByName(method.body));
    }
    operation["requestBody"] = {{"required", method.body != "*"},
                                {"content", {{"application/json", {{"schema", std::move(schema)}}}}}};
  }

  OrderedJson document_;
  std::map<std::string, int> bindings_;  // by operation id
  std::set<std::string> needed_;         // full names
  std::deque<const Descriptor*> messages_to_write_;
  std::map<std::string, OrderedJson> schemas_;
};

boost::asio::awaitable<void> AnswerOpenApi(std::shared_ptr<const std::string> document, Exchange& exchange) {
  HttpResponse response{.headers = {{"Content-Type", "application/json"}}, .body = *document};
  (void)co_await exchange.Respond(std::move(response));
}

}  // namespace

absl::StatusOr<std::unique_ptr<CommentedApi>> CommentedApi::Load() {
  google::protobuf::FileDescriptorSet set;
  if (!set.ParseFromArray(kApiDescriptors, static_cast<int>(kApiDescriptorsSize))) {
    return absl::InternalError("the descriptors that were built in cannot be read");
  }
  auto api = std::make_unique<CommentedApi>();
  for (const auto& file : set.file()) {
    const FileDescriptor* built = api->pool_.BuildFile(file);
    if (built == nullptr) return absl::InternalError(absl::StrCat("cannot build the descriptor of ", file.name()));
    const std::vector<const FileDescriptor*> ours = ApiFiles();
    const bool is_ours = std::any_of(ours.begin(), ours.end(),
                                     [&file](const FileDescriptor* our) { return our->name() == file.name(); });
    if (is_ours) api->files_.push_back(built);
  }
  return api;
}

std::string OpenApiDocument(const std::vector<const FileDescriptor*>& files, std::string_view version) {
  OpenApiWriter writer(version);
  for (const ApiMethod& method : ApiMethods(files)) writer.AddMethod(method);
  writer.AddFileRoutes();
  writer.AddPlain("/healthz", "Whether the process is up.");
  writer.AddPlain("/readyz", "Whether the server takes work; 503 if not.");
  writer.AddPlain("/metrics", "What the server counts and measures, in Prometheus' text format; for operators.",
                  /*open=*/false);
  writer.AddPlain("/openapi.json", "This document.");
  return writer.Finish(*files.front());
}

absl::Status AddOpenApi(Router& router) {
  ASSIGN_OR_RETURN(const std::unique_ptr<CommentedApi> api, CommentedApi::Load());
  const auto document = std::make_shared<const std::string>(OpenApiDocument(api->files(), DEPTHTWEEN_VERSION));
  router.Add("GET", "/openapi.json", [document](Exchange& exchange) { return AnswerOpenApi(document, exchange); });
  return absl::OkStatus();
}

}  // namespace depthtween::server
