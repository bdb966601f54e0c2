"""Networks of one layer, written by ONNX's own library, whose answers are known."""


def red_network(path, *, layout="nchw", gain=20.0, size=None, mask_input=False, classes=False, kind=1):
    """Logit ``gain * (red - 0.5)`` of RGB in 0 to 1, plus ``gain`` times the mask of the frame before where asked for.

    Args:
        path: of the file.
        layout: nchw or nhwc.
        gain: of the logit.
        size: (h, w), open unless given.
        mask_input: whether there is an input "before" of one channel, added to the logit.
        classes: whether the answer has two channels, the first zero.
        kind: of the tensors, 1 for float32.
    """
    from onnx import TensorProto, helper, save

    h, w = size or ("h", "w")
    nhwc = layout == "nhwc"
    shape = [1, h, w, 3] if nhwc else [1, 3, h, w]
    inputs = [helper.make_tensor_value_info("image", kind, shape)]
    weights = [gain, 0.0, 0.0]
    nodes, image = [], "image"
    if nhwc:
        nodes.append(helper.make_node("Transpose", ["image"], ["planes"], perm=[0, 3, 1, 2]))
        image = "planes"
    outputs = 2 if classes else 1
    values = [0.0] * 3 + weights if classes else weights
    bias = [0.0, -0.5 * gain] if classes else [-0.5 * gain]
    constants = [
        helper.make_tensor("weights", TensorProto.FLOAT, [outputs, 3, 1, 1], values),
        helper.make_tensor("bias", TensorProto.FLOAT, [outputs], bias),
    ]
    nodes.append(helper.make_node("Conv", [image, "weights", "bias"], ["logit" if not mask_input else "seen"]))
    if mask_input:
        inputs.append(helper.make_tensor_value_info("before", kind, [1, 1, h, w]))
        constants.append(helper.make_tensor("twice", TensorProto.FLOAT, [1], [gain]))
        nodes.append(helper.make_node("Mul", ["before", "twice"], ["remembered"]))
        nodes.append(helper.make_node("Add", ["seen", "remembered"], ["logit"]))
    name, shape = "logit", [1, outputs, h, w]
    if nhwc:
        nodes.append(helper.make_node("Transpose", ["logit"], ["answer"], perm=[0, 2, 3, 1]))
        name, shape = "answer", [1, h, w, outputs]
    answer = helper.make_tensor_value_info(name, kind, shape)
    graph = helper.make_graph(nodes, "red", inputs, [answer], constants)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)])
    model.ir_version = 8
    save(model, str(path))
    return path
