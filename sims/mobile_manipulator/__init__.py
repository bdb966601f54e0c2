"""A mobile manipulator among the objects of the VOS-VS trials: model, world, and the interfaces that policies see."""
