// VK_NV_cooperative_vector: whether a device has what the network needs, and matrices in the layout that it likes best.
#pragma once
#include "device.hpp"
#include "network.hpp"

// What headers older than 1.4.307 lack.
#ifndef VK_KHR_cooperative_matrix
typedef uint32_t VkComponentTypeKHR;
constexpr VkComponentTypeKHR VK_COMPONENT_TYPE_FLOAT16_KHR = 0;
#endif
#ifndef VK_NV_cooperative_vector
#define VK_NV_COOPERATIVE_VECTOR_EXTENSION_NAME "VK_NV_cooperative_vector"
constexpr auto VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_COOPERATIVE_VECTOR_FEATURES_NV = VkStructureType(1000491000);
constexpr auto VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_COOPERATIVE_VECTOR_PROPERTIES_NV = VkStructureType(1000491001);
constexpr auto VK_STRUCTURE_TYPE_COOPERATIVE_VECTOR_PROPERTIES_NV = VkStructureType(1000491002);
constexpr auto VK_STRUCTURE_TYPE_CONVERT_COOPERATIVE_VECTOR_MATRIX_INFO_NV = VkStructureType(1000491004);
typedef uint32_t VkCooperativeVectorMatrixLayoutNV;
constexpr VkCooperativeVectorMatrixLayoutNV VK_COOPERATIVE_VECTOR_MATRIX_LAYOUT_ROW_MAJOR_NV = 0;
constexpr VkCooperativeVectorMatrixLayoutNV VK_COOPERATIVE_VECTOR_MATRIX_LAYOUT_INFERENCING_OPTIMAL_NV = 2;
struct VkPhysicalDeviceCooperativeVectorPropertiesNV {
    VkStructureType sType;
    void* pNext;
    VkShaderStageFlags cooperativeVectorSupportedStages;
    VkBool32 cooperativeVectorTrainingFloat16Accumulation, cooperativeVectorTrainingFloat32Accumulation;
    uint32_t maxCooperativeVectorComponents;
};
struct VkPhysicalDeviceCooperativeVectorFeaturesNV {
    VkStructureType sType;
    void* pNext;
    VkBool32 cooperativeVector, cooperativeVectorTraining;
};
struct VkCooperativeVectorPropertiesNV {
    VkStructureType sType;
    void* pNext;
    VkComponentTypeKHR inputType, inputInterpretation, matrixInterpretation, biasInterpretation, resultType;
    VkBool32 transpose;
};
struct VkConvertCooperativeVectorMatrixInfoNV {
    VkStructureType sType;
    const void* pNext;
    size_t srcSize;
    VkDeviceOrHostAddressConstKHR srcData;
    size_t* pDstSize;
    VkDeviceOrHostAddressKHR dstData;
    VkComponentTypeKHR srcComponentType, dstComponentType;
    uint32_t numRows, numColumns;
    VkCooperativeVectorMatrixLayoutNV srcLayout;
    size_t srcStride;
    VkCooperativeVectorMatrixLayoutNV dstLayout;
    size_t dstStride;
};
typedef VkResult(VKAPI_PTR* PFN_vkGetPhysicalDeviceCooperativeVectorPropertiesNV)(VkPhysicalDevice, uint32_t*,
                                                                                  VkCooperativeVectorPropertiesNV*);
typedef VkResult(VKAPI_PTR* PFN_vkConvertCooperativeVectorMatrixNV)(VkDevice,
                                                                    const VkConvertCooperativeVectorMatrixInfoNV*);
typedef void(VKAPI_PTR* PFN_vkCmdConvertCooperativeVectorMatrixNV)(VkCommandBuffer, uint32_t,
                                                                   const VkConvertCooperativeVectorMatrixInfoNV*);
#endif
constexpr char REPLICATED[] = "VK_EXT_shader_replicated_composites";

// What a device has of all this, as its driver says; `features` is a chain for vkCreateDevice.
struct Cooperation {
    bool extension = false, half_products = false, replicated = false;
    VkPhysicalDeviceCooperativeVectorPropertiesNV limits = {};
    VkPhysicalDeviceCooperativeVectorFeaturesNV vectors = {};
    VkPhysicalDeviceVulkan12Features version12 = {};
    // that of VK_EXT_shader_replicated_composites, of newer headers
    struct Replicated {
        VkStructureType sType;
        void* pNext;
        VkBool32 shaderReplicatedComposites;
    } replicates = {};
    VkPhysicalDeviceFeatures2 features = {};

    Cooperation(VkInstance instance, VkPhysicalDevice physical) {
        VkPhysicalDeviceProperties2 about = {};
        about.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_PROPERTIES_2;
        limits.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_COOPERATIVE_VECTOR_PROPERTIES_NV;
        vkGetPhysicalDeviceProperties2(physical, &about);
        extension = about.properties.apiVersion >= VK_API_VERSION_1_2 &&
                    has(physical, VK_NV_COOPERATIVE_VECTOR_EXTENSION_NAME);
        if (!extension) return;
        about.pNext = &limits;
        vkGetPhysicalDeviceProperties2(physical, &about);
        replicated = has(physical, REPLICATED);
        vectors.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_COOPERATIVE_VECTOR_FEATURES_NV;
        version12.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_VULKAN_1_2_FEATURES;
        replicates.sType = VkStructureType(1000564000);
        features.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_FEATURES_2;
        link();
        vkGetPhysicalDeviceFeatures2(physical, &features);
        half_products = multiplies_halves(instance, physical);
    }

    void link() {
        features.pNext = &version12;
        version12.pNext = &vectors;
        vectors.pNext = replicated ? &replicates : nullptr;
    }

    static bool has(VkPhysicalDevice physical, const char* name) {
        uint32_t count = 0;
        vkEnumerateDeviceExtensionProperties(physical, nullptr, &count, nullptr);
        std::vector<VkExtensionProperties> all(count);
        vkEnumerateDeviceExtensionProperties(physical, nullptr, &count, all.data());
        return std::any_of(all.begin(), all.begin() + count,
                           [&](const VkExtensionProperties& each) { return !std::strcmp(each.extensionName, name); });
    }

    static bool multiplies_halves(VkInstance instance, VkPhysicalDevice physical) {
        const auto get = reinterpret_cast<PFN_vkGetPhysicalDeviceCooperativeVectorPropertiesNV>(
            vkGetInstanceProcAddr(instance, "vkGetPhysicalDeviceCooperativeVectorPropertiesNV"));
        uint32_t count = 0;
        if (!get || get(physical, &count, nullptr) != VK_SUCCESS) return false;
        VkCooperativeVectorPropertiesNV empty = {};
        empty.sType = VK_STRUCTURE_TYPE_COOPERATIVE_VECTOR_PROPERTIES_NV;
        std::vector<VkCooperativeVectorPropertiesNV> all(count, empty);
        if (get(physical, &count, all.data()) != VK_SUCCESS) return false;
        const auto half = VK_COMPONENT_TYPE_FLOAT16_KHR;
        return std::any_of(all.begin(), all.begin() + count, [&](const VkCooperativeVectorPropertiesNV& each) {
            return each.inputType == half && each.inputInterpretation == half && each.matrixInterpretation == half &&
                   each.biasInterpretation == half && each.resultType == half;
        });
    }

    // What is missing, or nothing.
    std::string lacks() const {
        uint32_t widest = 0;
        for (const auto& layer : network::layers) widest = std::max({widest, layer.rows, layer.columns});
        if (!extension) return "no VK_NV_cooperative_vector";
        if (!vectors.cooperativeVector) return "VK_NV_cooperative_vector without cooperativeVector";
        if (!half_products) return "VK_NV_cooperative_vector without float16 matrices";
        if (!(limits.cooperativeVectorSupportedStages & VK_SHADER_STAGE_COMPUTE_BIT))
            return "VK_NV_cooperative_vector, not in compute shaders";
        if (widest > limits.maxCooperativeVectorComponents)
            return "VK_NV_cooperative_vector of " + std::to_string(limits.maxCooperativeVectorComponents) +
                   " components at most, where this network needs " + std::to_string(widest);
        if (!replicates.shaderReplicatedComposites)
            return "VK_NV_cooperative_vector without shaderReplicatedComposites";
        if (!version12.shaderFloat16 || !version12.vulkanMemoryModel || !version12.bufferDeviceAddress)
            return "VK_NV_cooperative_vector without shaderFloat16, vulkanMemoryModel or bufferDeviceAddress";
        return "";
    }

    std::string says() const {
        if (!lacks().empty()) return lacks();
        return std::string("VK_NV_cooperative_vector with float16 matrices, cooperativeVector yes, ") +
               "cooperativeVectorTraining " + (vectors.cooperativeVectorTraining ? "yes" : "no");
    }

    // For vkCreateDevice: what the module needs of what there is.
    void* chain() {
        const VkPhysicalDeviceVulkan12Features there = version12;
        version12 = {};
        version12.sType = there.sType;
        version12.shaderFloat16 = there.shaderFloat16;
        version12.vulkanMemoryModel = there.vulkanMemoryModel;
        version12.bufferDeviceAddress = there.bufferDeviceAddress;
        features.features = {};
        vectors.cooperativeVectorTraining = VK_FALSE;
        link();
        return &features;
    }

    std::vector<const char*> extensions() const {
        return {VK_NV_COOPERATIVE_VECTOR_EXTENSION_NAME, REPLICATED};
    }
};

// matrices.bin as the module reads it: biases as they are, then each matrix, converted, from its offset on.
struct Matrices {
    Buffer buffer;
    std::vector<uint32_t> offsets;

    Matrices(const Device& on, const std::vector<char>& rows) {
        const auto convert = reinterpret_cast<PFN_vkConvertCooperativeVectorMatrixNV>(
            vkGetDeviceProcAddr(on.device, "vkConvertCooperativeVectorMatrixNV"));
        const auto convert_there = reinterpret_cast<PFN_vkCmdConvertCooperativeVectorMatrixNV>(
            vkGetDeviceProcAddr(on.device, "vkCmdConvertCooperativeVectorMatrixNV"));
        const size_t biases = network::layers[0].matrix, count = std::size(network::layers);
        std::vector<size_t> sizes(count);
        std::vector<VkConvertCooperativeVectorMatrixInfoNV> infos(count);
        size_t end = biases;
        for (size_t i = 0; i < count; ++i) {  // sizes first: all that the host's form does without a destination
            infos[i] = conversion(network::layers[i], &sizes[i]);
            check(convert(on.device, &infos[i]), "vkConvertCooperativeVectorMatrixNV");
            offsets.push_back(static_cast<uint32_t>(end));
            end += (sizes[i] + 63) / 64 * 64;
        }
        const Buffer source = on.uploaded(rows.data(), rows.size());
        buffer = on.buffer(end, false);
        for (size_t i = 0; i < count; ++i) {
            infos[i].srcData.deviceAddress = on.address(source) + network::layers[i].matrix;
            infos[i].dstData.deviceAddress = on.address(buffer) + offsets[i];
        }
        on.run([&](VkCommandBuffer to) {
            const VkBufferCopy copy = {0, 0, biases};
            vkCmdCopyBuffer(to, source.buffer, buffer.buffer, 1, &copy);
            convert_there(to, static_cast<uint32_t>(count), infos.data());
        });
    }

    static VkConvertCooperativeVectorMatrixInfoNV conversion(const network::Layer& layer, size_t* size) {
        VkConvertCooperativeVectorMatrixInfoNV info = {};
        info.sType = VK_STRUCTURE_TYPE_CONVERT_COOPERATIVE_VECTOR_MATRIX_INFO_NV;
        info.srcComponentType = info.dstComponentType = VK_COMPONENT_TYPE_FLOAT16_KHR;
        info.numRows = layer.rows;
        info.numColumns = layer.columns;
        info.srcStride = 2 * size_t(layer.columns);
        info.srcSize = info.srcStride * layer.rows;
        info.srcLayout = VK_COOPERATIVE_VECTOR_MATRIX_LAYOUT_ROW_MAJOR_NV;
        info.dstLayout = VK_COOPERATIVE_VECTOR_MATRIX_LAYOUT_INFERENCING_OPTIMAL_NV;
        info.pDstSize = size;
        return info;
    }
};
